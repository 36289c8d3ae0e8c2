//! `diffray verify`: the exact reference cases with every transport.

use std::num::NonZero;
use std::thread;

use diffray::error::Result;
use diffray::report;
use diffray::verify::{self, Extent};

use crate::cli::{self, VerifyArgs};
use crate::progress::Bar;

/// Runs, writes and prints.
pub(super) fn run(args: &VerifyArgs) -> Result<()> {
    report::check_writable(&args.out)?;
    let extent = if args.fast { Extent::Fast } else { Extent::Full };
    let processors = || thread::available_parallelism().map_or(1, NonZero::get);
    let threads = args.threads.map_or_else(processors, usize::from);
    let bar = Bar::of_steps(0, args.quiet);
    bar.set_message("cases");
    let verified = verify::run(extent, threads, &|done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
        bar.set_message(format!("{done} of {of} cases and transports"));
    });
    bar.finish_and_clear();
    let verified = verified?;
    super::publish(&args.out, args.quiet, |folder| verified.write(folder))?;
    cli::print(&verified.text())
}
