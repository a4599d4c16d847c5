//! `bench step`: what one whole step of a channel costs, as the number of centers N grows.
//!
//! | contestant | what a step is |
//! |---|---|
//! | dense | [`observer::Channel::step`], all centers |
//! | local | the same with the local solver, on lattices up to a million centers |
//! | literal | the same law as it is printed, with nalgebra: 3×3N and 3N×3N matrices, left to right |
//! | KRLS | an online kernel method of others, from the crate `irithyll`, on the same centers |
//! | Kalman | adskalman's filter with 6 states (velocity, disturbance) and 3 outputs |
//! | memory | reading memory, which is all that a step with many centers can be compared with |
//!
//! They take turns (`measure`). Before that, ours and the literal formula must have found the same force: two
//! different things are not compared.

mod channel;
mod figure;
mod kalman;
mod literal;
mod measure;
mod memory;
mod online_kernel;
mod report;

use crate::machine::Machine;
use crate::plot;
use anyhow::Context;
use clap::builder::TypedValueParser;
use indicatif::{ProgressBar, ProgressStyle};
use memory::MemoryProbe;
use observer::{BodyChannel, SolverInUse};
use shared_types::{logln, outln};
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Latency of one channel step by number of centers, against the paper's formula written out, an online kernel method
/// and a Kalman filter.
#[derive(Debug, Clone, clap::Args)]
pub struct StepArguments {
    /// Numbers of centers; cubes are laid out as a lattice, others as a quasi-random set.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "27,125,343,729,1000,2197,4096,8000",
        default_value_if("quick", "true", "27,125,343,1000,2197"),
        value_parser = parse_n_centers
    )]
    pub centers: Vec<usize>,
    /// Points along each axis of the cubic lattices for the local solver, with blocks of 4³ and 6³.
    #[arg(
        long,
        value_name = "n,n,…",
        value_delimiter = ',',
        default_value = "8,16,32,64,100",
        default_value_if("quick", "true", "8,100"),
        value_parser = clap::value_parser!(u32).range(8..=200).map(|edge| edge as usize)
    )]
    pub lattices: Vec<usize>,
    /// A first look within 20 s: fewer centers, and less time for each of them.
    #[arg(long)]
    pub quick: bool,
    /// Steps to time for each number of centers.
    #[arg(long, value_name = "COUNT", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub samples: u32,
    /// Stop a size after this long, with fewer samples.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value = "8",
        default_value_if("quick", "true", "1.2"),
        value_parser = parse_seconds
    )]
    pub seconds_per_size: f64,
    /// Run the literal formula up to this N: its matrix takes 72 N² bytes, and every step reads all of it.
    #[arg(long, value_name = "N", default_value = "1000", default_value_if("quick", "true", "343"))]
    pub literal_up_to: usize,
    /// Run kernel recursive least squares up to this N: filling its dictionaries takes 3 N³ multiply-adds.
    #[arg(long, value_name = "N", default_value = "1000", default_value_if("quick", "true", "343"))]
    pub krls_up_to: usize,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    pub json: bool,
    /// Draw the latencies to FILE, .svg or .png.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

/// 20 000 centers take 1.6 GB once factored, and three times that while they are.
const MOST_CENTERS: usize = 20_000;

fn parse_n_centers(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if (1..=MOST_CENTERS).contains(&n) => Ok(n),
        _ => Err(format!("needed: a number of centers from 1 to {MOST_CENTERS}")),
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(seconds) if (1e-3..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("needed: a number of seconds from 0.001 to 86400".into()),
    }
}

impl StepArguments {
    /// What is measured, in this order.
    fn sweep(&self) -> Vec<(Solver, usize)> {
        let dense = self.centers.iter().map(|&n| (Solver::Dense, n));
        let local =
            |&block: &usize| self.lattices.iter().map(move |&edge| (Solver::Local(block), edge.pow(3)));
        dense.chain([4, 6].iter().flat_map(local)).collect()
    }

    /// The literal formula where it is to be run, or why not.
    fn literal<T>(
        &self,
        subject: &Subject,
        build: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<Result<T, String>> {
        let (n, most) = (subject.n_centers, self.literal_up_to);
        if subject.solver != Solver::Dense {
            return Ok(Err("compared with the dense solver only".into()));
        }
        if n > most {
            let megabytes = 72e-6 * (n as f64).powi(2);
            return Ok(Err(format!(
                "not run beyond N = {most} (--literal-up-to): its matrix would take {megabytes:.0} MB"
            )));
        }
        build().map(Ok)
    }

    /// Kernel recursive least squares where it is to be run, or why not.
    fn krls<T>(&self, subject: &Subject, build: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        if subject.solver != Solver::Dense {
            return Err("compared with the dense solver only".into());
        }
        if subject.n_centers > self.krls_up_to {
            let most = self.krls_up_to;
            return Err(format!(
                "not run beyond N = {most} (--krls-up-to): filling its dictionaries takes long"
            ));
        }
        build()
    }
}

/// How f̂ is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Solver {
    /// With the factor of all centers: exact.
    Dense,
    /// From a block of so many lattice points along each axis.
    Local(usize),
}

impl Solver {
    const ALL: [Self; 3] = [Self::Dense, Self::Local(4), Self::Local(6)];

    /// As the configuration calls it.
    fn name(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Local(_) => "local",
        }
    }
}

impl Display for Solver {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dense => f.write_str("dense"),
            Self::Local(block) => write!(f, "local {block}³"),
        }
    }
}

/// A channel to be measured, and what its row says of it.
struct Subject {
    solver: Solver,
    n_centers: usize,
    /// How they are laid out.
    centers: String,
    /// What a step reads.
    bytes: usize,
    /// From the design to the channel.
    set_up_s: f64,
    /// RMS of the solver's error over that of f̂, for random updates; `None` where it is exact.
    predicted_error: Option<f64>,
    channel: BodyChannel,
}

impl Subject {
    fn build(solver: Solver, n_centers: usize) -> anyhow::Result<Self> {
        match solver {
            Solver::Dense => Self::dense(n_centers),
            Solver::Local(block) => Self::local(n_centers, block),
        }
    }

    fn local(n_centers: usize, block: usize) -> anyhow::Result<Self> {
        let edge = (n_centers as f64).cbrt().round() as usize;
        let design = channel::local_design(edge, block)?;
        let started = Instant::now();
        let channel = BodyChannel::new(&design)?;
        let set_up_s = started.elapsed().as_secs_f64();
        let SolverInUse::Local { predicted_error, .. } = channel.law().function().solver() else {
            anyhow::bail!("a lattice of {edge}³ centers is not solved locally");
        };
        Ok(Self {
            solver: Solver::Local(block),
            n_centers,
            centers: format!("lattice {edge}³"),
            bytes: channel.law().function().bytes_of_step(),
            set_up_s,
            predicted_error: Some(predicted_error),
            channel,
        })
    }

    fn dense(n_centers: usize) -> anyhow::Result<Self> {
        let (lattice, centers) = channel::centers(n_centers)?;
        let design = channel::design(lattice)?;
        let started = Instant::now();
        let channel = BodyChannel::new(&design)?;
        let set_up_s = started.elapsed().as_secs_f64();
        let bytes = channel.law().function().bytes_of_step();
        let (solver, predicted_error) = (Solver::Dense, None);
        Ok(Self { solver, n_centers, centers, bytes, set_up_s, predicted_error, channel })
    }
}

/// Measures, and prints the table or the JSON document.
///
/// Pins the calling thread to the core it runs on, and leaves it there.
///
/// # Errors
/// A plot that cannot be written (asked before measuring), centers that make no design, or two formulas
/// that disagree.
pub fn run(arguments: &StepArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    if cfg!(debug_assertions) {
        logln!("warning: this is a debug build, its latencies mean nothing; use cargo run --release");
    }
    // Its thread is not to be pinned to the core that is measured.
    let progress = progress_bar(arguments.sweep().len());
    let machine = Machine::found();
    let rows = rows(arguments, &progress)?;
    progress.finish_and_clear();
    if arguments.json {
        outln!("{:#}", report::document(&machine, &rows));
    } else {
        report::print(&machine, &rows);
    }
    if let Some(file) = &arguments.plot {
        figure::draw(file, &rows)?;
        if !arguments.json {
            outln!("plot: {}", file.display());
        }
    }
    Ok(())
}

fn rows(arguments: &StepArguments, progress: &ProgressBar) -> anyhow::Result<Vec<report::Row>> {
    // Sizes are built one after the other: the largest fill the memory.
    let sweep = arguments.sweep();

    let mut memory = MemoryProbe::new();
    let mut rows = Vec::with_capacity(sweep.len());
    for (i, (solver, n_centers)) in sweep.into_iter().enumerate() {
        let size = format!("{solver} N = {n_centers}");
        progress.set_message(format!("{size}: factoring"));
        let subject = Subject::build(solver, n_centers).with_context(|| size.clone())?;
        progress.set_message(size.clone());
        rows.push(measure::measure(subject, &mut memory, arguments, progress).context(size)?);
        progress.set_position((i as u64 + 1) * measure::PROGRESS);
    }
    Ok(rows)
}

/// Silent where stderr is not a terminal.
fn progress_bar(n_sizes: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg:28} {bar:40} {elapsed}");
    let progress = ProgressBar::new(n_sizes as u64 * measure::PROGRESS)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    progress.enable_steady_tick(Duration::from_millis(250));
    progress
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        step: StepArguments,
    }

    fn arguments(words: &[&str]) -> Result<StepArguments, clap::Error> {
        CommandLine::try_parse_from(["step"].iter().chain(words)).map(|line| line.step)
    }

    #[test]
    fn a_list_of_centers_is_split_at_commas() {
        assert_eq!(arguments(&[]).unwrap().centers, [27, 125, 343, 729, 1000, 2197, 4096, 8000]);
        assert_eq!(arguments(&["--quick", "--centers", "8, 50,27"]).unwrap().centers, [8, 50, 27]);
        for bad in ["0", "8,,27", "8;27", "-1", "100000"] {
            assert!(arguments(&["--centers", bad]).is_err(), "{bad}");
        }
        assert!(arguments(&["--samples", "0"]).is_err());
        assert!(arguments(&["--seconds-per-size", "nan"]).is_err());
    }

    #[test]
    fn quick_is_fewer_centers_and_less_time_where_nothing_else_is_asked_for() {
        let (usual, quick) = (arguments(&[]).unwrap(), arguments(&["--quick"]).unwrap());
        assert_eq!((usual.seconds_per_size, usual.literal_up_to, usual.krls_up_to), (8.0, 1000, 1000));
        assert_eq!((quick.seconds_per_size, quick.literal_up_to, quick.krls_up_to), (1.2, 343, 343));
        assert_eq!(quick.centers, [27, 125, 343, 1000, 2197]);
        assert_eq!(arguments(&["--quick", "--literal-up-to", "8"]).unwrap().literal_up_to, 8);
    }

    /// Not the times, which are the machine's affair: every figure is there and they are in order.
    #[test]
    fn a_short_measurement_fills_its_rows() {
        let words = [
            "--centers",
            "8,20",
            "--lattices",
            "8",
            "--samples",
            "250",
            "--literal-up-to",
            "8",
            "--krls-up-to",
            "8",
        ];
        let rows = rows(&arguments(&words).unwrap(), &ProgressBar::hidden()).unwrap();
        for row in &rows {
            assert_eq!(row.samples, 250);
            assert!(row.quantiles_ns.is_sorted());
            assert!(row.dead_zone_open > 0.9, "{}", row.dead_zone_open);
            assert!(row.memory_gb_per_s > 0.0 && row.kalman.samples > 0);
        }
        assert!(
            rows[0].literal.is_ok() && rows[0].literal_force_difference.is_some() && rows[0].krls.is_ok()
        );
        assert!(rows[1].literal.is_err() && rows[1].krls.is_err());
        let solvers: Vec<_> = rows.iter().map(|row| (row.solver, row.n_centers)).collect();
        let expected =
            [(Solver::Dense, 8), (Solver::Dense, 20), (Solver::Local(4), 512), (Solver::Local(6), 512)];
        assert_eq!(solvers, expected);
        let errors: Vec<_> = rows.iter().filter_map(|row| row.predicted_error).collect();
        assert!(errors.len() == 2 && errors[1] < errors[0], "{errors:?}");
    }
}
