//! `bench jitter`: how late the service's cycle wakes up.
//!
//! Measures the cycle's own wait function ([`daemon::deadline::wait_for_deadline`]), in a thread on a core of its own, beside
//! cyclictest at the same rate and priority on the same core. All take turns in slices of one run, so that drift affects
//! all alike. As cyclictest does, this program locks its memory and disables idle states; the report lists what was refused.

use crate::harness::latency::{HEADER, cells, summary};
use crate::harness::machine::Machine;
use crate::harness::options::{parse_rate_hz, parse_seconds};
use crate::harness::output::{progress_bar, say_if_stopped, show, table, three_digits, warn_of_debug_build};
use anyhow::{Context, anyhow, bail};
use command_line::stop_flag;
use daemon::deadline::{skip_missed, wait_for_deadline};
use daemon::system::real_time::{self, Refused};
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::{LatencySummary, outln};
use std::io::ErrorKind;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

/// Lateness of the cycle's wake-up, by scheduling and rate, beside cyclictest.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct JitterArguments {
    /// Rates of the timer.
    #[arg(long, value_name = "HZ,HZ,…", value_delimiter = ',', default_value = "100,200,1000,4000", value_parser = parse_rate_hz)]
    rates_hz: Vec<f64>,
    /// Length of the measurement for each mode and rate.
    #[arg(long, value_name = "S", default_value_t = 4.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Turns into which each of them is divided.
    #[arg(long, value_name = "COUNT", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    slices: u32,
    /// Priority of SCHED_FIFO.
    #[arg(long, value_name = "1…99", default_value_t = 80, value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: u8,
    /// How long mode fifo-spin polls the clock before each deadline.
    #[arg(long, value_name = "US", default_value_t = 200)]
    spin_us: u32,
    /// A few seconds: 0.2 s for each mode and rate.
    #[arg(long, conflicts_with = "seconds")]
    quick: bool,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
}

/// Which program waits, and how it is scheduled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Mode {
    Plain,
    Fifo,
    FifoSpin,
    CyclictestOther,
    CyclictestFifo,
}

impl Mode {
    const ALL: [Self; 5] =
        [Self::CyclictestOther, Self::Plain, Self::CyclictestFifo, Self::Fifo, Self::FifoSpin];

    fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Fifo => "fifo",
            Self::FifoSpin => "fifo-spin",
            Self::CyclictestOther => "cyclictest-other",
            Self::CyclictestFifo => "cyclictest-fifo",
        }
    }

    fn is_fifo(self) -> bool {
        !matches!(self, Self::Plain | Self::CyclictestOther)
    }
}

/// Runs `bench jitter`.
pub(crate) fn run(arguments: &JitterArguments) -> anyhow::Result<()> {
    warn_of_debug_build();
    let stop = stop_flag()?;
    let machine = Machine::found();
    // With one core, its own threads and the measured one share it.
    let core = machine.other_core().ok().or(machine.all_cores().first().copied()).unwrap_or(0);
    let (memory, awake) = (real_time::lock_memory(), real_time::keep_cores_awake());
    let seconds = if arguments.quick { 0.2 } else { arguments.seconds };
    let (n_slices, spin_ns) =
        (if arguments.quick { 1 } else { arguments.slices }, 1000 * u64::from(arguments.spin_us));

    let mut rows: Vec<Row> = Vec::new();
    for &rate_hz in &arguments.rates_hz {
        rows.extend(Mode::ALL.map(|mode| Row::new(mode, rate_hz)));
    }
    let n_turns = rows.len() as u64 * u64::from(n_slices);
    let progress = progress_bar(n_turns, "{msg:26} {bar:40} {elapsed} of about {duration}");
    for _ in 0..n_slices {
        for row in &mut rows {
            progress.set_message(format!("{} {} Hz", row.mode.name(), row.rate_hz));
            let n_wakes = (seconds * row.rate_hz / f64::from(n_slices)).ceil() as usize;
            let slice = Slice {
                mode: row.mode,
                rate_hz: row.rate_hz,
                n_wakes,
                core,
                priority: arguments.priority,
                spin_ns,
            };
            if row.lateness_ns_reason.is_none() && !stop.load(Ordering::Relaxed) {
                match slice.run(&stop)? {
                    Ok(samples_ns) => row.samples_ns.extend(samples_ns),
                    Err(reason) => row.lateness_ns_reason = Some(reason),
                }
            }
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    say_if_stopped(&stop);

    let granted = |refused: Option<&Refused>| refused.map_or("granted".into(), Refused::to_string);
    rows.iter_mut().for_each(Row::sum_up);
    let report = Report {
        machine: &machine,
        measured_core: core,
        priority: arguments.priority,
        spin_us: arguments.spin_us,
        memory_locked: granted(memory.as_ref().err()),
        cores_kept_awake: granted(awake.as_ref().err()),
        ratios: arguments.rates_hz.iter().map(|&rate_hz| Ratios::of(rate_hz, &rows)).collect(),
        rows,
    };
    drop(awake);
    show(arguments.json, &report, || report.print())
}

/// One turn of one mode at one rate.
#[derive(Debug, Clone, Copy)]
struct Slice {
    mode: Mode,
    rate_hz: f64,
    n_wakes: usize,
    core: usize,
    priority: u8,
    spin_ns: u64,
}

impl Slice {
    /// Lateness of each wake-up (ns), or why there is none.
    fn run(self, stop: &AtomicBool) -> anyhow::Result<Result<Vec<u64>, String>> {
        match self.mode {
            Mode::CyclictestOther | Mode::CyclictestFifo => self.cyclictest(),
            Mode::Plain | Mode::Fifo | Mode::FifoSpin => std::thread::scope(|scope| {
                let waiting = scope.spawn(|| self.wait(stop));
                match waiting.join() {
                    Ok(found) => Ok(found.map_err(|refused| refused.to_string())),
                    Err(_) => Err(anyhow!("the measuring thread panicked")),
                }
            }),
        }
    }

    /// Waits as the service's loop does, with the settings that it requests from the system.
    fn wait(self, stop: &AtomicBool) -> Result<Vec<u64>, Refused> {
        real_time::stay_on_cores(&[self.core])?;
        real_time::use_punctual_timers()?;
        if self.mode.is_fifo() {
            real_time::use_fifo(self.priority)?;
        }
        let spin_ns = if self.mode == Mode::FifoSpin { self.spin_ns } else { 0 };
        let period_ns = (1e9 / self.rate_hz) as u64;
        // Touched, so that no page is mapped between two deadlines.
        let mut lateness_ns = vec![1; self.n_wakes];
        lateness_ns.clear();
        let mut deadline_ns = monotonic_ns() + period_ns;
        while lateness_ns.len() < self.n_wakes && !stop.load(Ordering::Relaxed) {
            let wake_up = wait_for_deadline(deadline_ns, spin_ns);
            lateness_ns.push(wake_up.wake_ns - deadline_ns);
            skip_missed(&mut deadline_ns, monotonic_ns(), period_ns);
        }
        Ok(lateness_ns)
    }

    fn cyclictest(self) -> anyhow::Result<Result<Vec<u64>, String>> {
        let mut command = Command::new("cyclictest");
        command.args(["--quiet", "--mlockall", "--nsecs", "--threads=1"]);
        command.arg(format!("--histogram={HISTOGRAM_NS}"));
        command.arg(format!("--interval={}", (1e6 / self.rate_hz).round()));
        command.arg(format!("--loops={}", self.n_wakes));
        command.arg(format!("--affinity={}", self.core));
        match self.mode.is_fifo() {
            true => command.args(["--policy=fifo", &format!("--priority={}", self.priority)]),
            false => command.args(["--policy=other", "--priority=0"]),
        };
        // Its printing and our reading come after its measurement.
        let output = match command.stdin(Stdio::null()).output() {
            Ok(output) => output,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Ok(Err("cyclictest is not installed; apt-get install rt-tests".into()));
            }
            Err(error) => return Err(error).context("start cyclictest"),
        };
        let lateness_ns = read_histogram(&String::from_utf8_lossy(&output.stdout))?;
        if lateness_ns.is_empty() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Ok(Err(format!("cyclictest measured nothing ({}): {}", output.status, said.trim())));
        }
        Ok(Ok(lateness_ns))
    }
}

/// cyclictest counts each nanosecond up to here separately, and all later wake-ups together. Their lateness is taken to be
/// exactly this, which favours cyclictest.
const HISTOGRAM_NS: u64 = 1_000_000;

/// The samples of cyclictest's histogram: lines of lateness (ns) and count, between lines that begin with '#'.
fn read_histogram(text: &str) -> anyhow::Result<Vec<u64>> {
    let mut samples_ns = Vec::new();
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let number = |text: &str| text.trim().parse::<u64>().with_context(|| format!("cyclictest: '{line}'"));
        let (lateness_ns, count) = if let Some(overflows) = line.strip_prefix("# Histogram Overflows:") {
            (HISTOGRAM_NS, number(overflows)?)
        } else if line.starts_with('#') {
            continue;
        } else {
            let Some((lateness_ns, count)) = line.split_once([' ', '\t']) else {
                bail!("cyclictest: '{line}'; needed: a lateness and its count");
            };
            (number(lateness_ns)?, number(count)?)
        };
        samples_ns.extend(std::iter::repeat_n(lateness_ns, count as usize));
    }
    Ok(samples_ns)
}

/// One mode at one rate.
#[derive(Debug, Serialize)]
struct Row {
    mode: Mode,
    rate_hz: f64,
    lateness_ns: Option<LatencySummary>,
    /// The reason, if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    lateness_ns_reason: Option<String>,
    #[serde(skip)]
    samples_ns: Vec<u64>,
}

impl Row {
    fn new(mode: Mode, rate_hz: f64) -> Self {
        Self { mode, rate_hz, lateness_ns: None, lateness_ns_reason: None, samples_ns: Vec::new() }
    }

    /// Makes the summary of the samples.
    fn sum_up(&mut self) {
        self.lateness_ns = summary(&mut self.samples_ns);
        if self.lateness_ns.is_none() && self.lateness_ns_reason.is_none() {
            self.lateness_ns_reason = Some("stopped before its first turn".into());
        }
    }
}

/// Ours beside cyclictest's at one rate; null where one of the two was not measured.
#[derive(Debug, Serialize)]
struct Ratios {
    rate_hz: f64,
    plain_over_cyclictest_p50: Option<f64>,
    fifo_over_cyclictest_p50: Option<f64>,
    cyclictest_over_fifo_spin_p99: Option<f64>,
}

impl Ratios {
    fn of(rate_hz: f64, rows: &[Row]) -> Self {
        let ratio = |above: Mode, below: Mode, quantile: fn(LatencySummary) -> u64| {
            let find = |mode| rows.iter().find(|row| row.mode == mode && row.rate_hz == rate_hz)?.lateness_ns;
            Some(quantile(find(above)?) as f64 / quantile(find(below)?).max(1) as f64)
        };
        Self {
            rate_hz,
            plain_over_cyclictest_p50: ratio(Mode::Plain, Mode::CyclictestOther, |found| found.p50),
            fifo_over_cyclictest_p50: ratio(Mode::Fifo, Mode::CyclictestFifo, |found| found.p50),
            cyclictest_over_fifo_spin_p99: ratio(Mode::CyclictestFifo, Mode::FifoSpin, |found| found.p99),
        }
    }
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    machine: &'a Machine,
    measured_core: usize,
    priority: u8,
    spin_us: u32,
    /// "granted", or what was refused.
    memory_locked: String,
    /// "granted", or what was refused.
    cores_kept_awake: String,
    rows: Vec<Row>,
    ratios: Vec<Ratios>,
}

impl Report<'_> {
    fn print(&self) {
        self.machine.print();
        outln!(
            "measured on core {}, priority {}, spin {} µs; memory locked: {}; cores kept awake: {}",
            self.measured_core,
            self.priority,
            self.spin_us,
            self.memory_locked,
            self.cores_kept_awake
        );
        let row = |row: &Row| {
            let names = [row.mode.name().to_owned(), row.rate_hz.to_string()];
            [names.as_slice(), &cells(row.lateness_ns)].concat()
        };
        let header = [["late by (µs)", "Hz"].as_slice(), &HEADER].concat();
        outln!("{}", table(&header, 1, self.rows.iter().map(row)));
        let mut reasons: Vec<_> =
            self.rows.iter().filter_map(|row| row.lateness_ns_reason.as_ref()).collect();
        reasons.dedup();
        reasons.iter().for_each(|reason| outln!("not measured: {reason}"));
        let ratio = |ratio: Option<f64>| ratio.map_or("–".into(), three_digits);
        let row = |ratios: &Ratios| {
            vec![
                ratios.rate_hz.to_string(),
                ratio(ratios.plain_over_cyclictest_p50),
                ratio(ratios.fifo_over_cyclictest_p50),
                ratio(ratios.cyclictest_over_fifo_spin_p99),
            ]
        };
        let header = [
            "Hz",
            "plain / cyclictest-other, p50",
            "fifo / cyclictest-fifo, p50",
            "cyclictest-fifo / fifo-spin, p99",
        ];
        outln!("{}", table(&header, 0, self.ratios.iter().map(row)));
        outln!("cyclictest's wake-ups later than 1 ms are counted as 1 ms.");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_histogram_of_cyclictest_is_read() {
        let text = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n004942 000002\n005047\t000001\n\
                    # Total: 000000004\n# Max Latencies: 1200000\n# Histogram Overflows: 00001\n\
                    # Thread 0: 00007\n\n";
        assert_eq!(read_histogram(text).unwrap(), [4942, 4942, 5047, 1_000_000]);
        assert!(read_histogram("").unwrap().is_empty());
        for bad in ["12", "12 x", "# Histogram Overflows: many"] {
            assert!(read_histogram(bad).unwrap_err().to_string().contains("cyclictest"), "{bad}");
        }
    }

    /// The times depend on the machine; the test looks at which figures there are.
    #[test]
    fn a_slice_waits_as_often_as_it_was_told() {
        let core = real_time::allowed_cores()[0];
        for mode in [Mode::Plain, Mode::FifoSpin] {
            let slice = Slice { mode, rate_hz: 2000.0, n_wakes: 20, core, priority: 10, spin_ns: 50_000 };
            match slice.run(&AtomicBool::new(false)).unwrap() {
                Ok(lateness_ns) => assert_eq!(lateness_ns.len(), 20),
                Err(reason) => assert!(mode.is_fifo() && reason.contains("SCHED_FIFO"), "{reason}"),
            }
            assert!(
                slice.run(&AtomicBool::new(true)).unwrap().is_ok_and(|found| found.is_empty())
                    || mode.is_fifo()
            );
        }
    }

    #[test]
    fn ratios_are_of_the_same_rate_and_null_where_a_side_is_missing() {
        let row = |mode, rate_hz, ns: u64| {
            let mut row = Row::new(mode, rate_hz);
            row.samples_ns.push(ns);
            row.sum_up();
            row
        };
        let rows = [
            row(Mode::Fifo, 100.0, 30),
            row(Mode::CyclictestFifo, 100.0, 20),
            row(Mode::CyclictestFifo, 200.0, 10),
            row(Mode::FifoSpin, 100.0, 0),
            row(Mode::Plain, 100.0, 5),
            Row::new(Mode::CyclictestOther, 100.0),
        ];
        let ratios = Ratios::of(100.0, &rows);
        assert_eq!(ratios.fifo_over_cyclictest_p50, Some(1.5));
        assert_eq!(ratios.cyclictest_over_fifo_spin_p99, Some(20.0));
        assert_eq!(ratios.plain_over_cyclictest_p50, None);
    }
}
