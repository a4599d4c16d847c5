//! The command line of `daemon`.
//!
//! stdout carries results, stderr the log. Exit codes: 0 done, 1 failed while running, 2 wrong usage or
//! configuration.

use crate::config::{ConfigError, ConfigFile, PRESETS};
use crate::realtime::settings::{self, OffTheLoop};
use crate::{Service, StartError, check, doctor, say, service_manager};
use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};
use comfy_table::{Table, presets::NOTHING};
use shared_types::outln;
use shared_types::payload::{LatencySummary, Rejection, Status, command, outcome, real_time};
use shared_types::{Client, ClientError, Domain, DomainError};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// State estimation next to a flight or underwater vehicle's process.
///
/// Reads measurements from shared memory at a fixed rate, writes position, velocity, attitude, angular
/// velocity and the learned unknown force and torque back.
#[derive(Debug, Parser)]
#[command(name = "daemon", version, after_help = "Example: daemon run --preset rigid-body")]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Run the service until SIGINT or SIGTERM.
    #[command(
        after_help = "Examples:\n  daemon run --preset auv --instance auv1\n  daemon run --config vehicle.toml"
    )]
    Run {
        #[command(flatten)]
        design: DesignArguments,
        #[command(flatten)]
        real_time: RealTimeArguments,
        #[command(flatten)]
        place: PlaceArguments,
    },
    /// Print the effective configuration as commented TOML: a file to start from.
    #[command(after_help = "Example: daemon config --preset rigid-body > vehicle.toml")]
    Config {
        #[command(flatten)]
        design: DesignArguments,
    },
    /// Tell what is proven for a configuration, without starting anything.
    ///
    /// Controllability, observability, poles, strict positive realness, the error bounds of the theorems,
    /// the stability of the sampled law, the centers' cover and condition, and what would be better.
    #[command(
        after_help = "Examples:\n  daemon check --preset paper-translation\n  daemon check --config vehicle.toml --json"
    )]
    Check {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        design: DesignArguments,
    },
    /// Tell what this machine grants: measured, not believed.
    ///
    /// How late threads wake up with each setting; scheduling rights, locked memory, cores, clock, kernel,
    /// shared memory, stale files: each with the command that would help. Needs no rights; changes nothing.
    #[command(
        after_help = "Examples:\n  daemon doctor\n  daemon doctor --preset rigid-body --json\n  daemon doctor --seconds 10 --priority 50"
    )]
    Doctor(doctor::DoctorArguments),
    /// Talk to a running service.
    #[command(after_help = "Examples:\n  daemon control status\n  daemon control freeze --instance auv1")]
    Control {
        /// What to do.
        action: ControlAction,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        place: PlaceArguments,
    },
}

#[derive(Debug, Args)]
struct DesignArguments {
    /// Configuration file (TOML).
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Built-in configuration.
    #[arg(long, value_name = "NAME", default_value = PRESETS[0].0, value_parser = PRESETS.map(|(name, _)| name))]
    preset: String,
    /// Ticks per second, instead of the configuration's.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
}

/// Instead of the configuration's `[real_time]`.
#[derive(Debug, Args)]
struct RealTimeArguments {
    /// Refuse to start when the system refuses a real-time setting of the configuration.
    #[arg(long)]
    require_real_time: bool,
    /// SCHED_FIFO with this priority for the loop.
    #[arg(long, value_name = "1…98")]
    priority: Option<u8>,
    /// Cores of the loop.
    #[arg(long, value_name = "CORE,…", value_delimiter = ',')]
    cores: Option<Vec<usize>>,
}

impl RealTimeArguments {
    fn change(&self, file: &mut ConfigFile) {
        file.set_real_time(|real_time| {
            real_time.required |= self.require_real_time;
            real_time.priority = self.priority.or(real_time.priority);
            real_time.cores = self.cores.clone().or(real_time.cores.take());
        });
    }
}

#[derive(Debug, Args)]
pub(crate) struct PlaceArguments {
    /// Name of the vehicle; its services are NAME/measurement, NAME/estimate, …
    #[arg(long, value_name = "NAME", default_value = "vehicle")]
    pub(crate) instance: String,
    /// Root path of the shared-memory domain [default: /dev/shm/observer-UID].
    #[arg(long, value_name = "PATH", env = shared_types::domain::ROOT_VARIABLE)]
    root: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ControlAction {
    /// Forget state and learned weights; start again from the next sample.
    Reset,
    /// Stop learning; what was learned stays in use.
    Freeze,
    /// Learn again.
    Thaw,
    /// Write the learned weights to disk.
    Save,
    /// Show what the service did and does.
    Status,
}

/// Runs `daemon` with these arguments, the program's name first.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(args) {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    let done = match arguments.command {
        Task::Run { design, real_time, place } => run(&design, &real_time, &place),
        Task::Config { design } => config(&design),
        Task::Check { json, design } => check(json, &design),
        Task::Doctor(arguments) => doctor::run(&arguments),
        Task::Control { action, json, place } => control(action, json, &place),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say!("{error:#}");
            let wrong_usage = error.is::<ConfigError>()
                || error.is::<DomainError>()
                || error.downcast_ref::<StartError>().is_some_and(StartError::is_wrong_usage);
            ExitCode::from(if wrong_usage { 2 } else { 1 })
        }
    }
}

impl DesignArguments {
    fn read(&self) -> Result<ConfigFile, ConfigError> {
        let mut file = match &self.config {
            Some(path) => ConfigFile::read(path)?,
            None => ConfigFile::preset(&self.preset)?,
        };
        if let Some(rate_hz) = self.rate_hz {
            file.set_rate_hz(rate_hz);
        }
        Ok(file)
    }
}

impl PlaceArguments {
    pub(crate) fn domain(&self) -> Result<Domain, DomainError> {
        match &self.root {
            Some(root) => Domain::at(root),
            None => Domain::of_user(),
        }
    }
}

fn run(
    design: &DesignArguments,
    real_time: &RealTimeArguments,
    place: &PlaceArguments,
) -> anyhow::Result<()> {
    let mut config = design.read()?;
    real_time.change(&mut config);
    let domain = place.domain()?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("register signal handler")?;
    }
    let service = Service::start(&config, &domain, &place.instance)?;
    say!(
        "instance '{}' in {} at {} Hz; stop it with Ctrl-C or SIGTERM",
        place.instance,
        domain.root().display(),
        config.config.rate_hz
    );
    service_manager::tell_ready();
    let _off_the_loop = OffTheLoop::of_calling_thread(&config.config.real_time);
    while !stop.load(Ordering::Relaxed) {
        anyhow::ensure!(service.is_running(), "a thread ended by itself: a defect, please report it");
        std::thread::sleep(Duration::from_millis(20));
    }
    service_manager::tell_stopping();
    let status = service.stop();
    say!(
        "stopped after {} ticks; samples: {} used, {} lost, {} rejected; {} deadlines missed",
        status.ticks,
        status.samples_accepted,
        status.samples_lost,
        status.samples_rejected_total(),
        status.deadline_misses
    );
    Ok(())
}

fn config(design: &DesignArguments) -> anyhow::Result<()> {
    let file = design.read()?;
    file.estimator()?;
    outln!("{}", file.commented_toml().trim_end());
    Ok(())
}

fn check(json: bool, design: &DesignArguments) -> anyhow::Result<()> {
    let file = design.read()?;
    let checks = check::checks(&file)?;
    match json {
        true => outln!("{}", serde_json::to_string_pretty(&check::document(&file, &checks))?),
        false => check::print(&file, &checks),
    }
    // The same refusal as that of `daemon run`, and the same exit code.
    match checks.iter().find_map(check::ChannelCheck::refusal) {
        Some(refusal) => Err(refusal.clone().into()),
        None => Ok(()),
    }
}

fn control(action: ControlAction, json: bool, place: &PlaceArguments) -> anyhow::Result<()> {
    let domain = place.domain()?;
    let answer = (|| {
        let client = Client::connect(&domain, &place.instance, Duration::from_millis(500))?;
        client.command(action.kind(), Duration::from_secs(3))
    })();
    // A domain that only this question has made is taken away again, if it can be.
    let _ = domain.remove_if_unused();
    let reply = answer.map_err(|error: ClientError| anyhow::anyhow!(error))?;
    anyhow::ensure!(reply.outcome == outcome::DONE, "refused: {}", reply.text());
    match (json, action) {
        (true, _) => {
            let mut document = status_document(&reply.status)?;
            document["message"] = reply.text().into();
            outln!("{}", serde_json::to_string_pretty(&document)?);
        }
        (false, ControlAction::Status) => {
            print_status(&reply.status);
            print_refused(&reply.status, reply.text());
        }
        (false, _) => outln!("{}", reply.text()),
    }
    Ok(())
}

impl ControlAction {
    fn kind(self) -> u32 {
        match self {
            Self::Reset => command::RESET,
            Self::Freeze => command::FREEZE,
            Self::Thaw => command::THAW,
            Self::Save => command::SAVE,
            Self::Status => command::STATUS,
        }
    }
}

/// Bits of [`real_time`] that were asked for and refused.
fn refused_bits(status: &Status) -> impl Iterator<Item = u64> {
    let refused = status.real_time_requested & !status.real_time_granted;
    (0..u64::BITS).map(|k| 1 << k).filter(move |bit| refused & bit != 0)
}

/// The service's own words about what was refused, and what would help.
fn print_refused(status: &Status, text: &str) {
    if status.real_time_requested & !status.real_time_granted == 0 {
        return;
    }
    outln!("\n{text}");
    for bit in refused_bits(status) {
        outln!("  {}: {}", real_time::words(bit).join(" "), settings::remedy(bit));
    }
}

/// The status with the reasons of rejection and the real-time settings by name.
fn status_document(status: &Status) -> serde_json::Result<serde_json::Value> {
    let mut document = serde_json::to_value(status)?;
    let reasons =
        Rejection::ALL.map(|reason| (reason.words().replace(' ', "_"), status.rejected(reason).into()));
    document["samples_rejected"] = serde_json::Value::Object(reasons.into_iter().collect());
    let refused = refused_bits(status)
        .map(|bit| serde_json::json!({ "setting": real_time::words(bit).join(" "), "remedy": settings::remedy(bit) }));
    document["real_time"] = serde_json::json!({
        "granted": real_time::words(status.real_time_granted),
        "refused": refused.collect::<Vec<_>>(),
    });
    Ok(document)
}

fn print_status(status: &Status) {
    let seconds = |ns: u64| ns as f64 / 1e9;
    let age = match status.newest_sample_age_ns {
        u64::MAX => "none yet".into(),
        age_ns => format!("{:.3} s ago", seconds(age_ns)),
    };
    let rejected: Vec<_> = Rejection::ALL
        .into_iter()
        .filter(|&reason| status.rejected(reason) > 0)
        .map(|reason| format!("{} {}", status.rejected(reason), reason.words()))
        .collect();
    let source = |pid: u64| if pid == 0 { "none".into() } else { format!("process {pid}") };
    let mut facts = Table::new();
    facts.load_style(NOTHING);
    let mut fact = |name: &str, value: String| {
        facts.add_row([name, &value]);
    };
    fact("running for", format!("{:.1} s", seconds(status.stamp_ns - status.start_stamp_ns)));
    fact("rate", format!("{} Hz", status.rate_millihertz as f64 / 1e3));
    fact("ticks", format!("{}, {} deadlines missed", status.ticks, status.deadline_misses));
    fact("newest sample", format!("sequence {}, {age}", status.newest_sequence));
    fact("samples", format!("{} used, {} lost", status.samples_accepted, status.samples_lost));
    fact("rejected", if rejected.is_empty() { "0".into() } else { rejected.join("; ") });
    fact("source", format!("{}; another: {}", source(status.source_pid), source(status.other_source_pid)));
    fact("adaptation", if status.adaptation_frozen == 1 { "frozen".into() } else { "on".into() });
    let refused = real_time::words(status.real_time_requested & !status.real_time_granted).join(", ");
    let refused = if refused.is_empty() { "nothing".into() } else { refused };
    let granted = real_time::words(status.real_time_granted).join(", ");
    fact("real time", format!("granted: {granted}; refused: {refused}"));
    fact("coasting", format!("{} ticks", status.ticks_coasting));
    fact("clamped", format!("{} ticks", status.ticks_clamped));
    fact("state resets", status.state_resets.to_string());
    outln!("{facts}\n");

    let mut latencies = Table::new();
    latencies.load_style(NOTHING);
    latencies.set_header(["latency (µs)", "count", "p50", "p90", "p99", "p99.9", "max"]);
    let mut latency = |name: &str, summary: &LatencySummary| {
        let us = |ns: u64| format!("{:.1}", ns as f64 / 1e3);
        let LatencySummary { count, p50, p90, p99, p999, max } = *summary;
        latencies.add_row([name.into(), count.to_string(), us(p50), us(p90), us(p99), us(p999), us(max)]);
    };
    latency("wake-up lateness", &status.wake_up_lateness_ns);
    latency("step", &status.step_ns);
    latency("input age", &status.input_age_ns);
    latency("source to publish", &status.source_to_publish_ns);
    outln!("{latencies}");
}
