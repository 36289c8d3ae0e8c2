//! Acoustic ray tracing with diffraction by signed rays (see README.md).

pub mod error;
pub mod geometry;
pub mod probe;
pub mod scene;
pub mod trace;
