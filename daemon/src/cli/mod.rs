//! The command line of `daemon`.
//!
//! stdout carries results, stderr the log. Exit codes: 0 done, 1 failed while running, 2 wrong usage or
//! configuration.

use crate::assemble;
use crate::config::{ConfigError, ConfigFile, PRESETS, reference};
use crate::log::say;
use crate::service::{Service, ServiceFiles, StartError};
use crate::snapshot::{Snapshot, SnapshotError};
use crate::system::settings::{self, OffTheLoop};
use crate::system::{doctor, service_manager};
use crate::{check, snapshot};
use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};
use comfy_table::{Table, presets::NOTHING};
use shared_types::outln;
use shared_types::payload::{LatencySummary, Rejection, Status, command, outcome, real_time, restored};
use shared_types::{Client, ClientError, Domain, DomainError};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, UNIX_EPOCH};

/// Environment variable that names the directory of the snapshots.
pub(crate) const STATE_VARIABLE: &str = "OBSERVER_STATE";

/// State estimation next to a flight or underwater vehicle's process.
///
/// Reads measurements from shared memory at a fixed rate, writes position, velocity, attitude, angular
/// velocity and the learned unknown force and torque back.
#[derive(Debug, Parser)]
#[command(
    name = "daemon",
    after_help = "\
Examples:
  # A multicopter's service; the simulator, or a vehicle, feeds it
  daemon run --preset rigid-body
  # A configuration to start from, and what is proven for it
  daemon config --preset auv > vehicle.toml
  daemon check --config vehicle.toml"
)]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Run the service until SIGINT or SIGTERM.
    #[command(after_help = "\
Examples:
  # A second vehicle on this machine
  daemon run --preset auv --instance auv1
  # What flies: a core of its own, and no start without it
  daemon run --config vehicle.toml --cores 2 --require-real-time
  # Every sample and tick, to replay: bench replay --check flight.rec
  daemon run --config vehicle.toml --record flight.rec")]
    Run {
        #[command(flatten)]
        design: DesignArguments,
        #[command(flatten)]
        real_time: RealTimeArguments,
        #[command(flatten)]
        place: PlaceArguments,
        #[command(flatten)]
        files: FileArguments,
    },
    /// Look at a snapshot of what was learned.
    #[command(after_help = SNAPSHOT_EXAMPLES)]
    Snapshot {
        #[command(subcommand)]
        task: SnapshotTask,
    },
    /// Print the effective configuration as commented TOML: a file to start from.
    #[command(after_help = "\
Examples:
  # A file to start from, each key with what it means
  daemon config --preset rigid-body > vehicle.toml
  # What a file means with all defaults; refused with its line if it is wrong
  daemon config --config vehicle.toml")]
    Config {
        #[command(flatten)]
        design: DesignArguments,
    },
    /// Print what every key of a configuration means: type, unit, default, bounds, an example.
    #[command(after_help = "\
Examples:
  daemon config-reference | less
  # For an editor that knows TOML: the line #:schema PATH above a configuration
  daemon config-reference --schema > configuration.schema.json")]
    ConfigReference {
        /// Print the JSON schema instead of the text.
        #[arg(long)]
        schema: bool,
    },
    /// Tell what is proven for a configuration, without starting anything.
    ///
    /// Controllability, observability, poles, strict positive realness, the error bounds of the theorems,
    /// the stability of the sampled law, the centers' cover and condition, and what would be better.
    #[command(after_help = "\
Examples:
  # Exit code 2 if the service would refuse it
  daemon check --config vehicle.toml
  daemon check --preset paper-translation --json")]
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
    #[command(after_help = "\
Examples:
  daemon doctor
  # Ten seconds for each setting, at another priority
  daemon doctor --seconds 10 --priority 50
  # The rate and the settings of a configuration
  daemon doctor --config vehicle.toml --json")]
    Doctor(doctor::DoctorArguments),
    /// Print the domain's iceoryx2 configuration, for programs of others.
    ///
    /// iox2, and the link to another machine (docs/across-machines.md), read it as config/iceoryx2.toml in
    /// the directory in which they are started. The root path is made here, if it is missing, so that it is
    /// this user's alone.
    #[command(after_help = "\
Examples:
  mkdir -p link/config
  daemon iceoryx2-config > link/config/iceoryx2.toml")]
    Iceoryx2Config {
        /// Root path of the shared-memory domain [default: /dev/shm/observer-UID].
        #[arg(long, value_name = "PATH", env = shared_types::domain::ROOT_VARIABLE)]
        root: Option<PathBuf>,
    },
    /// Talk to a running service.
    #[command(after_help = "\
Examples:
  # What it did, how late it was, what the system granted
  daemon control status
  # Keep what was learned as it is, and write it down
  daemon control freeze --instance auv1
  daemon control save --instance auv1")]
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

const SNAPSHOT_EXAMPLES: &str = "\
Examples:
  daemon snapshot show ~/.local/state/observer/*vehicle.snapshot
  daemon snapshot show vehicle.snapshot --json";

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

#[derive(Debug, Subcommand)]
enum SnapshotTask {
    /// Print what is inside.
    #[command(after_help = SNAPSHOT_EXAMPLES)]
    Show {
        /// The snapshot.
        file: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

#[derive(Debug, Args)]
struct FileArguments {
    /// Directory of the snapshots; "none" keeps none [default: $STATE_DIRECTORY, $XDG_STATE_HOME/observer or ~/.local/state/observer].
    #[arg(long, value_name = "DIR", env = STATE_VARIABLE)]
    state: Option<PathBuf>,
    /// Begin anew instead of with the snapshot, which is kept as .old.
    #[arg(long)]
    fresh: bool,
    /// Append every sample and tick to this file; `bench replay --check FILE` replays it to the same bits.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

impl FileArguments {
    fn files(&self) -> anyhow::Result<ServiceFiles> {
        let in_context =
            |directory: &Path| format!("the directory of the snapshots '{}'", directory.display());
        let asked = self.state.is_some();
        let state = match state_directory(self.state.as_deref()) {
            None => None,
            Some(directory) => match snapshot::make_directory(&directory) {
                Ok(()) => Some(directory),
                Err(error) if asked => return Err(error).with_context(|| in_context(&directory)),
                // Nobody asked for this one: without it the service runs all the same.
                Err(error) => {
                    say!("warning: {}: {error}", in_context(&directory));
                    None
                }
            },
        };
        if state.is_none() {
            say!("no snapshots: what is learned lives as long as the service (--state DIR keeps it)");
        }
        Ok(ServiceFiles { state, is_fresh: self.fresh, record: self.record.clone() })
    }
}

/// Where snapshots go: what was asked for, but for "none"; or what the service manager, or the user's home, offers.
pub(crate) fn state_directory(asked: Option<&Path>) -> Option<PathBuf> {
    if let Some(asked) = asked {
        let is_none = asked.as_os_str() == "none" || asked.as_os_str().is_empty();
        return (!is_none).then(|| asked.to_owned());
    }
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    absolute("STATE_DIRECTORY")
        .or_else(|| Some(absolute("XDG_STATE_HOME")?.join("observer")))
        .or_else(|| Some(absolute("HOME")?.join(".local/state/observer")))
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
        let real_time = &mut file.config.real_time;
        real_time.required |= self.require_real_time;
        real_time.priority = self.priority.or(real_time.priority);
        real_time.cores = self.cores.clone().or(real_time.cores.take());
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
    let arguments = match command_line::parse::<Arguments>(args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let done = match arguments.command {
        Task::Run { design, real_time, place, files } => run(&design, &real_time, &place, &files),
        Task::Snapshot { task: SnapshotTask::Show { file, json } } => show_snapshot(&file, json),
        Task::Config { design } => config(&design),
        Task::ConfigReference { schema } => {
            let text = if schema { reference::json_schema() } else { reference::markdown() };
            outln!("{}", text.trim_end());
            Ok(())
        }
        Task::Check { json, design } => check(json, &design),
        Task::Doctor(arguments) => doctor::run(&arguments),
        Task::Iceoryx2Config { root } => iceoryx2_config(root.as_deref()),
        Task::Control { action, json, place } => control(action, json, &place),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say!("{error:#}");
            let wrong_usage = error.is::<ConfigError>()
                || error.is::<DomainError>()
                || matches!(error.downcast_ref(), Some(SnapshotError::Damaged { .. }))
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
            file.config.rate_hz = rate_hz;
        }
        Ok(file)
    }
}

impl PlaceArguments {
    pub(crate) fn domain(&self) -> Result<Domain, DomainError> {
        Domain::at_or_of_user(self.root.as_deref())
    }
}

fn iceoryx2_config(root: Option<&Path>) -> anyhow::Result<()> {
    let domain = Domain::at_or_of_user(root)?;
    // Whoever reads this would make the root path open to its group, and without our lock in it.
    drop(domain.lock_for_making()?);
    outln!("{}", toml::to_string(&domain.config_for_others()).context("write as TOML")?.trim_end());
    Ok(())
}

fn run(
    design: &DesignArguments,
    real_time: &RealTimeArguments,
    place: &PlaceArguments,
    files: &FileArguments,
) -> anyhow::Result<()> {
    let mut config = design.read()?;
    real_time.change(&mut config);
    let domain = place.domain()?;
    let files = files.files()?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("register signal handler")?;
    }
    let service = Service::start(&config, &domain, &place.instance, &files)?;
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

fn show_snapshot(file: &Path, json: bool) -> anyhow::Result<()> {
    let snapshot = Snapshot::read(file)?;
    if json {
        outln!("{}", serde_json::to_string_pretty(&snapshot)?);
        return Ok(());
    }
    let made = UNIX_EPOCH.elapsed().map_or(0, |now| now.as_secs().saturating_sub(snapshot.made_unix_s));
    let mut facts = Table::new();
    facts.load_style(NOTHING);
    let mut fact = |name: &str, value: String| {
        facts.add_row([name, &value]);
    };
    fact("instance", snapshot.instance);
    fact("made", format!("{made} s ago, by version {}", snapshot.program_version));
    fact("samples used", snapshot.samples_accepted.to_string());
    let learned = &snapshot.kept.learned;
    let nonzero = learned.iter().filter(|number| **number != 0.0).count();
    fact("learned", format!("{} numbers, {nonzero} of them not zero", learned.len()));
    let state = snapshot.kept.state.map(|state| state.estimator);
    let numbers = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(" ");
    if let Some(body) = state.and_then(|state| state.rigid_body) {
        if let Some((position, velocity)) = body.position_and_velocity() {
            fact("position (m)", numbers(position.as_slice()));
            fact("velocity (m/s)", numbers(velocity.as_slice()));
        }
        if let Some((attitude, angular_velocity)) = body.attitude_and_angular_velocity() {
            fact("attitude wxyz", numbers(&[attitude.w, attitude.i, attitude.j, attitude.k]));
            fact("angular velocity (rad/s)", numbers(angular_velocity.as_slice()));
        }
    }
    if let Some(linear) = state.and_then(|state| state.linear) {
        fact("state", numbers(linear.state().as_slice()));
    }
    for (key, value) in snapshot.meaning {
        fact(&key, value);
    }
    outln!("{facts}");
    Ok(())
}

fn config(design: &DesignArguments) -> anyhow::Result<()> {
    let file = design.read()?;
    assemble::estimator(&file)?;
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
        client.command(action.kind(), Duration::from_secs(20))
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
    let [v, w, y] = status.outputs_held_back;
    fact("held back", format!("{v} velocities, {w} angular velocities, {y} outputs that stand out"));
    let [v, w, y] = status.outputs_stuck;
    fact("stuck", format!("{v} velocities, {w} angular velocities, {y} outputs"));
    fact(
        "late ticks",
        format!(
            "{} in a row now, {} at most; {} predicted only, {} invalid",
            status.late_ticks_in_a_row,
            status.most_late_ticks_in_a_row,
            status.ticks_predict_only,
            status.ticks_invalid
        ),
    );
    let restored = match status.snapshot_restored {
        restored::LEARNED => "what was learned restored at the start",
        restored::LEARNED_AND_STATE => "what was learned and the state restored at the start",
        _ => "nothing restored at the start",
    };
    let newest = match status.snapshot_stamp_ns {
        0 => "none yet".into(),
        stamp_ns => format!("newest {:.1} s ago", seconds(status.stamp_ns.saturating_sub(stamp_ns))),
    };
    let failed = status.snapshots_failed;
    fact("snapshots", format!("{} saved, {failed} failed, {newest}; {restored}", status.snapshots_saved));
    fact(
        "flight record",
        format!("{} ticks, {} not recorded", status.ticks_recorded, status.ticks_not_recorded),
    );
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_help_ends_in_examples_that_are_accepted() {
        assert_eq!(command_line::faults_of_help::<Arguments>(), Vec::<String>::new());
    }
}
