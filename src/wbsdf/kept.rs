//! Tables that belong to numbers alone: found once, kept for all that ask for the same.

use std::sync::{Arc, Mutex, PoisonError};

/// What is known, by its key.
pub(super) struct Kept<K, T>(Mutex<Vec<(K, Arc<T>)>>);

impl<K: PartialEq, T> Kept<K, T> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// What belongs to `key`: made by `new`, which must not ask here, if it is the first to ask.
    pub(super) fn of(&self, key: K, new: impl FnOnce() -> T) -> Arc<T> {
        // A panic leaves what is kept whole.
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = all.iter().find(|(known, _)| *known == key) {
            return Arc::clone(known);
        }
        let new = Arc::new(new());
        all.push((key, Arc::clone(&new)));
        new
    }
}
