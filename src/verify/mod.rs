//! The program against exact solutions: every reference case with every transport, its errors and its time per level.
//!
//! The cases and their exact levels stand in `reference/*.csv`, each with its method. A case is run as a user would run it, from
//! the text of a room file; the time is that of the deterministic paths and levels on one thread, apart from that of what all
//! sources and probes of a scene share.

mod cases;
mod measure;
mod page;
mod summary;
mod text;

use std::io::Write as _;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::report::Folder;
use crate::scene::{RAY_TOLERANCE, Transport};

pub use cases::{Case, Reference};
pub use measure::{Measured, Method};
pub use summary::{Bar, Quantiles, Ratio, SetUp};

/// How much is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// Every case, three ray budgets.
    Full,
    /// One case of a kind, two ray budgets.
    Fast,
}

impl Extent {
    /// Ray budgets: relative accuracy of the sums over signed rays, the last one is what rooms get.
    fn tolerances(self) -> &'static [f64] {
        match self {
            Extent::Full => &[2e-1, 2e-2, RAY_TOLERANCE],
            Extent::Fast => &[2e-2, RAY_TOLERANCE],
        }
    }

    /// No case of the exact transport is begun after this many seconds of it.
    fn exact_s(self) -> f64 {
        match self {
            Extent::Full => 150.0,
            Extent::Fast => 6.0,
        }
    }
}

/// Probes of a case that the exact transport, thousands of times slower, is run for.
const EXACT_PROBES: usize = 2;

/// One case with one transport.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Number of the case.
    pub index: usize,
    /// The case, cut to what was run.
    pub case: Case,
    /// The transport.
    pub method: Method,
    /// What it gave.
    pub measured: Measured,
}

/// Everything that was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Verified {
    /// How much was run.
    pub extent: Extent,
    /// The transports in the order of the tables.
    pub methods: Vec<Method>,
    /// In the order of cases and transports.
    pub trials: Vec<Trial>,
    /// Transports that refused cases or had no time for them, and for how many.
    pub left_out: Vec<(String, usize)>,
    /// Seconds in all.
    pub time_s: f64,
}

/// The transports to compare, signed rays first.
fn methods(extent: Extent) -> Vec<Method> {
    let rays = Method::new(Transport::Wbsdf, "wbsdf");
    let budgets = extent.tolerances().iter().map(|&tolerance| Method { tolerance, ..rays });
    let others = [
        Method::new(Transport::Paraxial, "paraxial"),
        Method::new(Transport::Geometric, "geometric"),
        Method::new(Transport::Utd, "utd"),
        Method::new(Transport::Exact, "exact"),
    ];
    budgets.chain(others).collect()
}

/// Every case with every transport, in the order in which they are run: the exact ones last, and of these one of every kind of
/// case before the second of any.
fn jobs(cases: &[Case], methods: &[Method]) -> Vec<(usize, Method)> {
    let each = |exact: bool| {
        let chosen = move |m: &&Method| (m.transport == Transport::Exact) == exact;
        (0..cases.len()).flat_map(move |i| methods.iter().filter(chosen).map(move |m| (i, *m)))
    };
    let before = |i: usize| cases[..i].iter().filter(|c| c.name == cases[i].name).count();
    let mut exact: Vec<(usize, Method)> = each(true).collect();
    exact.sort_by_key(|(i, _)| before(*i));
    each(false).chain(exact).collect()
}

/// Runs the cases. `progress` is called after each with how many are done, and of how many.
///
/// Each runs on one thread, `threads` of them at a time.
///
/// # Errors
/// If a thread cannot be started or a case cannot be run.
pub fn run(extent: Extent, threads: usize, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Verified> {
    let start = Instant::now();
    let cases = match extent {
        Extent::Full => cases::all()?,
        Extent::Fast => cases::few(cases::all()?),
    };
    let methods = methods(extent);
    let jobs = jobs(&cases, &methods);
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let exact_since: OnceLock<Instant> = OnceLock::new();
    let work = || -> Result<Vec<(usize, Method, Option<Trial>)>> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|e| Error::Run(format!("cannot start a thread: {e}")))?;
        let mut found = Vec::new();
        while let Some(&(index, method)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let exact = method.transport == Transport::Exact;
            let late = exact && exact_since.get_or_init(Instant::now).elapsed().as_secs_f64() > extent.exact_s();
            let trial = if late {
                None
            } else {
                let case = if exact { cases[index].of_probes(EXACT_PROBES) } else { cases[index].clone() };
                let measured = pool.install(|| measure::measure(&case, &method))?;
                measured.map(|measured| Trial { index, case, method, measured })
            };
            found.push((index, method, trial));
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
        }
        Ok(found)
    };
    let parts: Vec<Result<Vec<_>>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(work)).collect();
        let lost = |_| Err(Error::Run("a thread of the verification ended early".to_owned()));
        workers.into_iter().map(|w| w.join().unwrap_or_else(lost)).collect()
    });
    let mut all = Vec::with_capacity(jobs.len());
    for part in parts {
        all.extend(part?);
    }
    all.sort_by_key(|(index, method, _)| (*index, methods.iter().position(|m| m == method)));
    let absent = |m: &Method| all.iter().filter(|(_, method, trial)| method == m && trial.is_none()).count();
    let left_out = methods.iter().map(|m| (m.label(), absent(m))).filter(|(_, n)| *n > 0).collect();
    let trials = all.into_iter().filter_map(|(.., trial)| trial).collect();
    Ok(Verified { extent, methods, trials, left_out, time_s: start.elapsed().as_secs_f64() })
}

impl Verified {
    /// Writes `verify.csv` and `report.html`.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be written, [`Error::Run`] if a chart cannot be drawn.
    pub fn write(&self, folder: &mut Folder) -> Result<()> {
        folder.write("verify.csv", |out| text::write_csv(out, self))?;
        let page = page::page(self)?;
        folder.write("report.html", |out| out.write_all(page.as_bytes()))
    }

    /// Tables for the terminal.
    pub fn text(&self) -> String {
        text::tables(self)
    }
}
