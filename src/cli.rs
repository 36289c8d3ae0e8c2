//! The command line: arguments, what goes to the terminal, and the exit status.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anstyle::{AnsiColor, Style};
use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use diffray::error::{Error, Warning};

/// Acoustic ray tracing in which sound bends round edges and through door gaps.
///
/// Rooms are described in a TOML file. Results are levels, impulse responses and a report.
#[derive(Debug, Parser)]
#[command(name = "diffray", version, max_term_width = 100, arg_required_else_help = true)]
#[command(after_help = "Exit status: 0 done, 1 the input or the run failed, 2 wrong usage.")]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a room: levels, impulse responses, room-acoustic parameters and a report
    Simulate(RunArgs),
    /// Simulate a room for every value of one parameter, and list where closing a door raises the level
    ///
    /// The parameter and its values come from the room file's [sweep], or from --set PATH=FROM:TO:STEP or
    /// --set PATH=V1,V2,...; other --set options change the room as usual.
    Sweep(SweepArgs),
    /// Hear a recording as it sounds in a room: convolves it with the impulse responses
    ///
    /// Writes listen/SOURCE-PROBE.wav; one gain for all keeps their loudness apart and is told.
    Listen(ListenArgs),
    /// Show what will be modelled for a room, per portal and band, and why; runs nothing
    Plan(RoomArgs),
    /// Check a room file; runs nothing
    Check(RoomArgs),
    /// Run the exact reference cases with every transport: error against time
    ///
    /// Writes report.html and verify.csv and prints the tables.
    Verify(VerifyArgs),
    /// Print a completion script for a shell
    Completions {
        /// The shell
        shell: Shell,
    },
}

/// The room and what to change in it.
#[derive(Debug, Args)]
pub(crate) struct RoomArgs {
    /// The room file
    #[arg(value_name = "ROOM.toml")]
    pub(crate) room: PathBuf,
    /// Change a value of the room file, as opening.door.open_m=0.3; may be given several times
    #[arg(long, value_name = "PATH=VALUE", value_parser = setting)]
    pub(crate) set: Vec<String>,
    /// Seed of every random number [simulation.seed]
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Stop when the standard error of every level is below this many dB [simulation.target_db]
    #[arg(long, value_name = "X")]
    pub(crate) target_db: Option<f64>,
    /// Trace at most this many rays, as 2000000 or 2e6 [simulation.max_rays]
    #[arg(long, value_name = "N", value_parser = count)]
    pub(crate) max_rays: Option<u64>,
    /// Trace for at most this many seconds [simulation.max_time_s]
    #[arg(long, value_name = "S")]
    pub(crate) max_time: Option<f64>,
}

/// A run and where its results go.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// The room.
    #[command(flatten)]
    pub(crate) room: RoomArgs,
    /// Directory for the results [default: out/<room file stem>]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Number of threads [default: one per processor]; the results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// No progress on the terminal
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

/// A sweep, and what to hear of it.
#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// The runs.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Write one WAV file a value as well: the recording as heard there, or the impulse response if none is given
    #[arg(long, value_name = "DRY.wav", num_args = 0..=1, default_missing_value = "-")]
    pub(crate) listen: Option<PathBuf>,
}

/// A run and what to hear in it.
#[derive(Debug, Args)]
pub(crate) struct ListenArgs {
    /// The run.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// The recording without a room; a WAV file of any sample rate, its channels are mixed to one
    #[arg(long, value_name = "DRY.wav")]
    pub(crate) dry: PathBuf,
}

/// How much to verify and where the results go.
#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// One case of a kind: seconds instead of minutes
    #[arg(long)]
    pub(crate) fast: bool,
    /// Directory for the results
    #[arg(long, value_name = "DIR", default_value = "verify")]
    pub(crate) out: PathBuf,
    /// Number of cases at a time, each on one thread [default: one per processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// No progress on the terminal
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

impl RunArgs {
    /// Where the results go.
    pub(crate) fn out(&self) -> PathBuf {
        match (&self.out, self.room.room.file_stem()) {
            (Some(out), _) => out.clone(),
            (None, Some(stem)) => PathBuf::from("out").join(stem),
            (None, None) => PathBuf::from("out"),
        }
    }
}

/// `PATH=VALUE` with something on both sides.
fn setting(text: &str) -> Result<String, String> {
    match text.split_once('=') {
        Some((path, value)) if !path.trim().is_empty() && !value.trim().is_empty() => Ok(text.to_owned()),
        _ => Err("must be PATH=VALUE, as opening.door.open_m=0.3".to_owned()),
    }
}

/// A whole number, also as 2_000_000 or 2e6.
fn count(text: &str) -> Result<u64, String> {
    let digits = text.replace('_', "");
    let refused = || format!("must be a whole number from 0 to {}, as 2000000 or 2e6", u64::MAX);
    match (digits.parse::<u64>(), digits.parse::<f64>()) {
        (Ok(n), _) => Ok(n),
        // Below 2^53 every whole f64 is exact.
        (_, Ok(x)) if x >= 0.0 && x.fract() == 0.0 && x < 9.0e15 => Ok(x as u64),
        _ => Err(refused()),
    }
}

/// Writes results to the standard output. A reader that went away (as `| head` does) is no error.
///
/// # Errors
/// [`Error::File`] if the output cannot be written.
pub(crate) fn print(text: &str) -> Result<(), Error> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::File { path: PathBuf::from("standard output"), action: "write", source: error })
        }
        _ => Ok(()),
    }
}

/// Writes a line about the run to the standard error, with a word before it in bold and in this colour (on a terminal).
fn tell(word: &str, color: AnsiColor, text: &str) {
    let style = Style::new().bold().fg_color(Some(color.into()));
    // There is nowhere left to say that the standard error cannot be written.
    let _ = writeln!(anstream::stderr().lock(), "{style}{word}:{style:#} {text}");
}

/// Tells about what the user should know.
pub(crate) fn warn(warnings: &[Warning]) {
    for warning in warnings {
        tell("warning", AnsiColor::Yellow, &warning.observation);
        tell("hint", AnsiColor::Cyan, &warning.remedy);
    }
}

/// Tells where the results are.
pub(crate) fn tell_results(place: &std::path::Path) {
    tell("results", AnsiColor::Green, &place.display().to_string());
}

/// Turns the outcome into the exit status, after telling what went wrong.
pub(crate) fn exit_status(outcome: Result<(), Error>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    let text = error.to_string();
    let (message, hint) = match &error {
        Error::Input { hint: Some(hint), .. } => {
            (text.strip_suffix(hint.as_str()).map_or(&*text, |t| t.trim_end_matches("\nhint: ")), Some(hint))
        }
        _ => (&*text, None),
    };
    tell("error", AnsiColor::Red, message);
    if let Some(hint) = hint {
        tell("hint", AnsiColor::Cyan, hint);
    }
    ExitCode::FAILURE
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn counts_may_be_written_as_powers_of_ten() {
        assert_eq!(count("2e6"), Ok(2_000_000));
        assert_eq!(count("10_000_000"), Ok(10_000_000));
        assert_eq!(count("18446744073709551615"), Ok(u64::MAX));
        for bad in ["-1", "1.5", "many", "", "inf", "1e99"] {
            assert!(count(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn results_go_to_a_directory_named_after_the_room_file() {
        let parse = |args: &[&str]| match Cli::parse_from(args).command {
            Command::Simulate(args) => args.out(),
            other => panic!("{other:?}"),
        };
        assert_eq!(parse(&["diffray", "simulate", "rooms/door.toml"]), PathBuf::from("out/door"));
        assert_eq!(parse(&["diffray", "simulate", "door.toml", "--out", "x"]), PathBuf::from("x"));
    }
}
