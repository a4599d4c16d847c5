//! The program: arguments, checked; a source of samples; publication; one line about it.

use crate::faults::{
    Fault, FaultError, Faults, Faulty, Reach, Tally, check_faults, help as fault_help, read_faults,
};
use crate::mavlink::link::{Link, LinkError};
use crate::mavlink::{MavlinkError, MavlinkOptions, bridge};
use crate::publish::{Outgoing, Pace, Published, connect, publish};
use crate::replay::{Format, ImportError, ImportOptions, read_flight, say_findings, write_table};
use crate::scenario::Scenario;
use crate::sensors::Outage;
use crate::simulation::{DEFAULT_RATE_HZ, Simulation, SimulationError, SimulationOptions};
use crate::supervise::{self, Message, SuperviseError, Supervised, supervise};
use clap::{Args, Parser, Subcommand};
use shared_types::service::ServiceError;
use shared_types::{Client, ClientError, Domain, DomainError};
use shared_types::{logln, outln};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::cell::Cell;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The vehicle's side of the estimation service: a simulated vehicle, a recorded flight, or a live one, as samples.
///
/// Results go to stdout, the log to stderr. Exit code 0: done (Ctrl-C included); 1: failed while running;
/// 2: wrong usage.
#[derive(Debug, Parser)]
#[command(
    name = "sim_publisher",
    after_help = "\
Examples:
  # A multicopter in wind, until Ctrl-C
  sim_publisher run --scenario rigid-body
  # A recorded flight
  sim_publisher replay --format acsl flight.log --airborne-only"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulates a vehicle with its sensors and faults
    #[command(after_help = format!("{}\n\n\
Examples:
  # Samples that come late, get lost, and stay away
  sim_publisher run --scenario auv --dropout-probability 0.02 \\
      --jitter-us 300 --outage 10:0.5 --outage 20:1
  # As a table, at once
  sim_publisher run --scenario auv --duration 60 --table dive.csv
  # Spikes, then a killed vehicle's process; a summary for scripts
  sim_publisher run --scenario rigid-body --duration 20 --json \\
      --faults 'spike@5:2,size=3,every=10; kill@12:1'", fault_help()))]
    Run(RunArgs),
    /// Plays a recorded flight
    #[command(after_help = "\
Keys of --column and --map (SI; a quantity has all of its components or none). A
column that bears a key's own name needs no naming, body_velocity_x|y|z neither:
  time_s, or time with time_unit = s|ms|us|ns;  separator (default ,)
  velocity_x|y|z with velocity_frame = inertial|body;  angular_velocity_x|y|z
  position_x|y|z;  attitude_w|x|y|z;  force_x|y|z;  torque_x|y|z

Examples:
  sim_publisher replay --format acsl flight.log --airborne-only
  sim_publisher replay flight.ulg --mass-kg 1.5 --airborne-only
  # A recording of monitor record; another one (JSON or Protocol Buffers)
  sim_publisher replay flight.mcap
  sim_publisher replay bag.mcap --column velocity_x=/dvl:v.0 \\
      --column velocity_y=/dvl:v.1 --column velocity_z=/dvl:v.2
  # Four times as fast, with clock = \"samples\" in the service's configuration
  sim_publisher replay --format csv flight.csv --map map.toml --speed 4
  sim_publisher replay --format csv flight.csv --column time_s=t \\
      --column velocity_x=vx --column velocity_y=vy --column velocity_z=vz")]
    Replay(ReplayArgs),
    /// Tells what a log holds, and which options and rates to use
    #[command(after_help = "\
Examples:
  sim_publisher inspect flight.ulg
  sim_publisher inspect flight.csv --column time_s=t --json")]
    Inspect(InspectArgs),
    /// Bridges to a live vehicle: its MAVLink messages as samples, the estimate back
    #[command(after_help = "\
Taken: ODOMETRY, or LOCAL_POSITION_NED with ATTITUDE_QUATERNION or ATTITUDE;
thrust from ATTITUDE_TARGET, with --thrust-n. Sent: HEARTBEAT, TIMESYNC, and
what is asked for; without signatures. An estimate made from a vehicle's own
estimate is no second sensor: let no vehicle fuse what --send returns of its own
data.

Examples:
  # Whoever sends to this port: PX4, ArduPilot, or a router
  sim_publisher mavlink --listen udp:0.0.0.0:14550
  # On the vehicle's serial port, asking for 100 Hz; the thrust in newtons
  sim_publisher mavlink --listen serial:/dev/ttyUSB0:921600 \\
      --request-rate-hz 100 --thrust-n 39.2
  # The estimate back, to another program
  sim_publisher mavlink --listen udp:127.0.0.1:14550 --send odometry \\
      --send-to 127.0.0.1:14560 --send-rate-hz 30")]
    Mavlink(MavlinkArgs),
}

#[derive(Debug, Args)]
struct MavlinkArgs {
    #[command(flatten)]
    mavlink: MavlinkOptions,
    #[command(flatten)]
    target: TargetArgs,
}

#[derive(Debug, Args)]
struct TargetArgs {
    /// Which service to feed
    #[arg(long, value_name = "NAME", default_value = "vehicle")]
    instance: String,
    /// Root path of the shared memory's domain [default: $OBSERVER_ROOT, else the user's own]
    #[arg(long, value_name = "PATH")]
    root: Option<PathBuf>,
    /// Print one JSON document instead of a line
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// Which vehicle
    #[arg(long, value_enum)]
    scenario: Scenario,
    /// Length of the run in s [default: until Ctrl-C]
    #[arg(long, visible_alias = "duration-s", value_name = "S")]
    duration: Option<f64>,
    /// Rate of the samples
    #[arg(long, value_name = "HZ", default_value_t = DEFAULT_RATE_HZ)]
    rate_hz: f64,
    /// Seed of all chance: the same options give the same samples
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// White noise of the velocity, standard deviation of each axis [default: the scenario's]
    #[arg(long, value_name = "M_S")]
    velocity_noise_m_s: Option<f64>,
    /// White noise of the angular velocity, standard deviation of each axis [default: the scenario's]
    #[arg(long, value_name = "RAD_S")]
    angular_velocity_noise_rad_s: Option<f64>,
    /// Constant error of the velocity: one number for each axis, or three with commas [default: 0]
    #[arg(long, value_name = "M_S", value_parser = parse_axes, allow_hyphen_values = true)]
    velocity_bias_m_s: Option<[f64; 3]>,
    /// Sample instants deviate from the even ones by up to this
    #[arg(long, value_name = "US", default_value_t = 0.0)]
    jitter_us: f64,
    /// Probability that a sample is lost; its sequence is used up
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    dropout_probability: f64,
    /// No sample arrives from START for LENGTH seconds; may be repeated
    #[arg(long, value_name = "START:LENGTH", value_parser = Outage::parse)]
    outage: Vec<Outage>,
    /// Rate of noisy position fixes [default: only the start is known]
    #[arg(long, value_name = "HZ")]
    position_fix_hz: Option<f64>,
    /// No gusts, no variation of the current
    #[arg(long)]
    calm: bool,
    /// Faults at stated times, see below, or a file of them; may be repeated
    #[arg(long, value_name = "SPEC|FILE")]
    faults: Vec<String>,
    /// Write the samples to this file as a table (csv), at once, instead of publishing them
    #[arg(long, value_name = "FILE", requires = "duration")]
    table: Option<PathBuf>,
    /// This process publishes for a supervisor, which stops and kills it
    #[arg(long, hide = true)]
    worker: bool,
    /// The start of the run that this worker continues
    #[arg(long, hide = true, requires = "worker")]
    resumed_start_ns: Option<u64>,
    /// Since when, after the start, nobody published
    #[arg(long, hide = true, default_value_t = u64::MAX)]
    dead_since_ns: u64,
    #[command(flatten)]
    target: TargetArgs,
}

#[derive(Debug, Args)]
struct ReplayArgs {
    /// How the flight is written [default: by the file's ending]
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// The recorded flight
    file: PathBuf,
    /// How many times faster than it was flown; stamps keep the flight's own time
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    speed: f64,
    /// Only the part in the air (acsl, ulog)
    #[arg(long)]
    airborne_only: bool,
    #[command(flatten)]
    import: ImportOptions,
    #[command(flatten)]
    target: TargetArgs,
}

#[derive(Debug, Args)]
struct InspectArgs {
    /// How the log is written [default: by the file's ending]
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// The log
    file: PathBuf,
    #[command(flatten)]
    import: ImportOptions,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Why the program ends without having done its work.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    #[error(transparent)]
    Faults(#[from] FaultError),
    #[error(transparent)]
    Supervise(#[from] SuperviseError),
    #[error(transparent)]
    Import(#[from] ImportError),
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Client(#[from] ClientError),
    #[error(transparent)]
    Mavlink(#[from] MavlinkError),
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("{0}")]
    Usage(String),
    #[error("cannot write '{path}': {cause}")]
    Table { path: String, cause: std::io::Error },
    #[error("cannot listen to signals: {0}")]
    Signals(#[from] std::io::Error),
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Client(ClientError::Service(ServiceError::InstanceName(_))) => 2,
            // The worker's own: it said why.
            Self::Supervise(SuperviseError::Ended(code)) => u8::try_from(*code).unwrap_or(1),
            Self::Mavlink(MavlinkError::Option(_)) => 2,
            Self::Mavlink(_) | Self::Link(_) => 1,
            Self::Client(_) | Self::Signals(_) | Self::Supervise(_) | Self::Table { .. } => 1,
            Self::Simulation(_) | Self::Faults(_) | Self::Import(_) | Self::Domain(_) | Self::Usage(_) => 2,
        }
    }
}

pub(crate) fn parse_axes(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[each]) => Ok([each; 3]),
        Ok(&[x, y, z]) => Ok([x, y, z]),
        _ => Err(format!("'{text}': needed: one number, or three with commas, for example 0.1,0,0")),
    }
}

/// Runs the program with these arguments, the program's name first.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match command_line::parse::<Cli>(args) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let outcome = match cli.command {
        Command::Run(args) => run(&args),
        Command::Replay(args) => replay(&args),
        Command::Inspect(args) => inspect(&args),
        Command::Mavlink(args) => mavlink(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            logln!("sim_publisher: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn options(args: &RunArgs) -> SimulationOptions {
    SimulationOptions {
        scenario: args.scenario,
        rate_hz: args.rate_hz,
        duration_s: args.duration,
        seed: args.seed,
        velocity_noise_m_s: args.velocity_noise_m_s,
        angular_velocity_noise_rad_s: args.angular_velocity_noise_rad_s,
        velocity_bias_m_s: args.velocity_bias_m_s,
        position_fix_hz: args.position_fix_hz,
        disturbed: args.calm.then_some(false),
        jitter_us: args.jitter_us,
        dropout_probability: args.dropout_probability,
        outages: args.outage.clone(),
    }
}

/// The faults of a run, which can be those of this process and of its samples.
fn faults(args: &RunArgs, options: &SimulationOptions) -> Result<Vec<Fault>, Failure> {
    let faults = read_faults(&args.faults)?;
    check_faults(&faults, options)?;
    match faults.iter().find(|fault| fault.kind.reach() == Reach::Service) {
        Some(fault) => Err(Failure::Usage(format!(
            "fault '{fault}': the service is not this program's; needed: bench demo --faults '{fault}'"
        ))),
        None => Ok(faults),
    }
}

fn run(args: &RunArgs) -> Result<(), Failure> {
    let options = options(args);
    let simulation = Simulation::new(&options)?;
    let faults = faults(args, &options)?;
    if let Some(path) = &args.table {
        return write_samples(path, simulation, &faults, args);
    }
    let (name, rate_hz, seed) = (args.scenario.name(), args.rate_hz, args.seed);
    let (published, tallies) = if supervise::is_needed(&faults) && !args.worker {
        let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
        let Supervised { published, tallies } = supervise(&arguments, &faults, &*stop_flag()?)?;
        let tally = |(&fault, samples)| Tally { fault, samples };
        (published, faults.iter().zip(tallies).map(tally).collect())
    } else {
        let mut source = Faulty::new(simulation, Faults::new(&faults, seed));
        let until = args.duration.map_or("until Ctrl-C".into(), |duration_s| format!("for {duration_s} s"));
        let what = format!("scenario '{name}' at {rate_hz} Hz, seed {seed}, {until}");
        let published = match args.worker {
            true => work(args, &mut source, &what)?,
            false => publish_source(&args.target, &what, &mut source, Pace::live(), |_| ())?,
        };
        (published, source.tallies())
    };
    if args.worker {
        let tallies = tallies.iter().map(|tally| tally.samples).collect();
        outln!("{}", line(&Message::Ended { published, tallies }));
        return Ok(());
    }
    let fault = |Tally { fault, samples }: &Tally| {
        serde_json::json!({
            "fault": fault.to_string(),
            "kind": fault.kind.name(),
            "start_s": fault.span.start_s,
            "length_s": fault.span.length_s,
            "samples": samples,
        })
    };
    let details = [
        ("scenario", name.into()),
        ("rate_hz", rate_hz.into()),
        ("seed", seed.into()),
        ("faults", tallies.iter().map(fault).collect()),
    ];
    report(&args.target, &published, details);
    if !args.target.json {
        for Tally { fault, samples } in &tallies {
            outln!("  {fault}: {samples} samples");
        }
    }
    Ok(())
}

/// The samples as a table, in the order in which they would arrive.
fn write_samples(
    path: &Path,
    simulation: Simulation,
    faults: &[Fault],
    args: &RunArgs,
) -> Result<(), Failure> {
    if supervise::is_needed(faults) {
        return Err(Failure::Usage("--table: no process is stopped or killed; leave such faults out".into()));
    }
    let source = Faulty::new(simulation, Faults::new(faults, args.seed));
    let samples: Vec<_> =
        source.filter_map(|outgoing| outgoing.delivery).map(|delivery| delivery.measurement).collect();
    let cannot_write = |cause| Failure::Table { path: path.display().to_string(), cause };
    let file = std::fs::File::create(path).map_err(cannot_write)?;
    write_table(std::io::BufWriter::new(file), &samples).map_err(cannot_write)?;
    match args.target.json {
        true => outln!("{}", serde_json::json!({ "samples_written": samples.len(), "file": path })),
        false => outln!("{} samples written to '{}'", samples.len(), path.display()),
    }
    Ok(())
}

/// Publishes as a worker: tells the supervisor when it starts, and how many samples nobody sent since the last worker died.
fn work(args: &RunArgs, source: impl Iterator<Item = Outgoing>, what: &str) -> Result<Published, Failure> {
    supervise::end_with_supervisor();
    let pace = Pace { resumed_start_ns: args.resumed_start_ns, ..Pace::live() };
    let sent_before = Cell::new(0);
    let counted = source.inspect(|outgoing| {
        let before = outgoing.delivery.is_some() && outgoing.at_ns < args.dead_since_ns;
        sent_before.set(sent_before.get() + u64::from(before));
    });
    publish_source(&args.target, what, counted, pace, |published| {
        let &Published { start_stamp_ns, samples_skipped, .. } = published;
        let samples_missed = samples_skipped.saturating_sub(sent_before.get());
        outln!("{}", line(&Message::Started { start_stamp_ns, samples_missed }));
    })
}

fn line(message: &Message) -> String {
    serde_json::to_string(message).expect("numbers and names")
}

fn replay(args: &ReplayArgs) -> Result<(), Failure> {
    if !(args.speed > 0.0 && args.speed <= 1000.0) {
        return Err(Failure::Usage(format!("--speed {}: needed: above 0, at most 1000", args.speed)));
    }
    let format = format_of(args.format, &args.file)?;
    let mut flight = read_flight(format, &args.file, &args.import)?;
    let file = args.file.display().to_string();
    say_findings(&flight, &file);
    if args.airborne_only {
        flight = flight.airborne_only().ok_or_else(|| {
            Failure::Usage(match format {
                Format::Acsl => {
                    format!("--airborne-only: '{file}' has no thrust above 5 N; leave the option out")
                }
                Format::Ulog => format!("--airborne-only: '{file}' tells of no flight; leave the option out"),
                Format::Csv | Format::Mcap | Format::Record => {
                    "--airborne-only: this format does not tell; leave the option out".into()
                }
            })
        })?;
    }
    if args.speed != 1.0 {
        logln!(
            "stamps keep the flight's own time while it passes {} times as fast: \
             the service must run with clock = \"samples\" in its configuration",
            args.speed
        );
    }
    let what = format!(
        "'{file}': {} samples, {:.1} s, at {} times its speed",
        flight.samples.len(),
        flight.duration_s(),
        args.speed
    );
    let skipped_rows = flight.skipped_rows();
    let source = flight.samples.into_iter().map(Outgoing::from);
    let pace = Pace { speed: args.speed, ..Pace::live() };
    let published = publish_source(&args.target, &what, source, pace, |_| ())?;
    let details =
        [("file", file.into()), ("speed", args.speed.into()), ("rows_skipped", skipped_rows.into())];
    report(&args.target, &published, details);
    Ok(())
}

fn format_of(given: Option<Format>, file: &Path) -> Result<Format, Failure> {
    given.or_else(|| Format::of(file)).ok_or_else(|| {
        Failure::Usage(format!("'{}': its ending tells no format; needed: --format", file.display()))
    })
}

fn inspect(args: &InspectArgs) -> Result<(), Failure> {
    let findings = crate::inspect::inspect(format_of(args.format, &args.file)?, &args.file, &args.import)?;
    match args.json {
        true => outln!("{}", serde_json::to_string_pretty(&findings).expect("numbers and names")),
        false => outln!("{findings}"),
    }
    Ok(())
}

/// Set by Ctrl-C and its like, from now on.
fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Takes from a live vehicle until the end, and gives the estimate back.
fn mavlink(args: &MavlinkArgs) -> Result<(), Failure> {
    let MavlinkArgs { mavlink: options, target } = args;
    options.settings()?;
    // First: a wire that cannot be used is told before anybody waits for the service.
    let link = Link::open(options.address())?;
    let stop = stop_flag()?;
    let Some((domain, client)) = connected(target, &stop)? else { return Ok(()) };
    logln!("{} to instance '{}' in {}", options.address(), target.instance, domain.root().display());
    let bridged = bridge(options, link, &client, &stop)?;
    drop(client);
    domain.remove_if_unused()?;
    match target.json {
        true => outln!("{}", bridged.document()),
        false => outln!("{}", bridged.line()),
    }
    Ok(())
}

/// The service of this instance, once it is there; `None` where a stop came first.
fn connected(target: &TargetArgs, stop: &AtomicBool) -> Result<Option<(Domain, Client)>, Failure> {
    let domain = Domain::at_or_of_user(target.root.as_deref())?;
    let (instance, root) = (&target.instance, domain.root().display());
    let client = connect(&domain, instance, stop, || {
        logln!(
            "waiting for the service of instance '{instance}' in {root}; \
             start it: daemon run --instance {instance} --root {root}"
        );
    })?;
    let Some(client) = client else {
        logln!("stopped before the service of instance '{instance}' was there; nothing was published");
        domain.remove_if_unused()?;
        return Ok(None);
    };
    Ok(Some((domain, client)))
}

/// Waits for the service and publishes; nothing where a stop came before the service.
fn publish_source(
    target: &TargetArgs,
    what: &str,
    source: impl Iterator<Item = Outgoing>,
    pace: Pace,
    started: impl FnOnce(&Published),
) -> Result<Published, Failure> {
    let stop = stop_flag()?;
    let Some((domain, client)) = connected(target, &stop)? else {
        return Ok(Published { stopped: true, ..Published::default() });
    };
    let (instance, root) = (&target.instance, domain.root().display());
    logln!("publishing to instance '{instance}' in {root}: {what}");
    let published = publish(&client, source, pace, &stop, started)?;
    drop(client);
    // The last one of a domain leaves nothing behind; while the service runs this does nothing.
    domain.remove_if_unused()?;
    Ok(published)
}

fn report<const N: usize>(
    target: &TargetArgs,
    published: &Published,
    details: [(&str, serde_json::Value); N],
) {
    let duration_s = published.duration_ns as f64 * 1e-9;
    if !target.json {
        let ending = if published.stopped { ", stopped" } else { "" };
        outln!(
            "{} samples published, {} dropped on purpose, {duration_s:.3} s, {} more than 1 ms late (at most {:.3} ms){ending}",
            published.samples_published,
            published.samples_dropped,
            published.samples_late,
            published.largest_lateness_ns as f64 * 1e-6,
        );
        return;
    }
    let mut document = serde_json::json!({
        "samples_published": published.samples_published,
        "samples_dropped": published.samples_dropped,
        "samples_late": published.samples_late,
        "largest_lateness_ns": published.largest_lateness_ns,
        "duration_s": duration_s,
        "start_stamp_ns": published.start_stamp_ns,
        "stopped": published.stopped,
    });
    for (key, value) in details {
        document[key] = value;
    }
    outln!("{document}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    fn parsed(line: &str) -> Result<Cli, clap::Error> {
        Cli::try_parse_from(line.split_whitespace())
    }

    fn code_of(line: &str) -> ExitCode {
        main_with_args(line.split_whitespace().map(OsString::from))
    }

    #[test]
    fn every_help_ends_in_examples_that_are_accepted() {
        Cli::command().debug_assert();
        assert_eq!(command_line::faults_of_help::<Cli>(), Vec::<String>::new());
    }

    #[test]
    fn options_reach_the_simulation() {
        let line = "sim_publisher run --scenario rigid-body --duration 2.5 --rate-hz 100 --seed 9 \
            --velocity-noise-m-s 0.1 --angular-velocity-noise-rad-s 0.2 --velocity-bias-m-s -0.1,0,0.3 \
            --jitter-us 50 --dropout-probability 0.1 --outage 1:0.5 --outage 2:.25 --position-fix-hz 5 --calm";
        let Command::Run(args) = parsed(line).unwrap().command else { panic!("run") };
        let expected = SimulationOptions {
            scenario: Scenario::RigidBody,
            rate_hz: 100.0,
            duration_s: Some(2.5),
            seed: 9,
            velocity_noise_m_s: Some(0.1),
            angular_velocity_noise_rad_s: Some(0.2),
            velocity_bias_m_s: Some([-0.1, 0.0, 0.3]),
            position_fix_hz: Some(5.0),
            disturbed: Some(false),
            jitter_us: 50.0,
            dropout_probability: 0.1,
            outages: vec![Outage { start_s: 1.0, length_s: 0.5 }, Outage { start_s: 2.0, length_s: 0.25 }],
        };
        assert_eq!(options(&args), expected);
        let Command::Run(args) = parsed("sim_publisher run --scenario auv").unwrap().command else {
            panic!("run")
        };
        assert_eq!(options(&args), SimulationOptions::of(Scenario::Auv));
    }

    #[test]
    fn wrong_words_are_refused_with_what_would_be_accepted() {
        for (line, expected) in [
            ("sim_publisher run", "--scenario"),
            ("sim_publisher run --scenario boat", "rigid-body"),
            ("sim_publisher run --scenario auv --outage 3", "needed: START:LENGTH"),
            ("sim_publisher run --scenario auv --velocity-bias-m-s 1,2", "three with commas"),
            ("sim_publisher replay --format xlsx f", "acsl"),
        ] {
            let message = parsed(line).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn wrong_usage_ends_with_code_two_before_anything_is_opened() {
        for line in [
            "sim_publisher",
            "sim_publisher run --scenario rigid-body --rate-hz 1",
            "sim_publisher run --scenario rotation --velocity-noise-m-s 0.1",
            "sim_publisher run --scenario auv --root relative",
            "sim_publisher run --scenario rigid-body --faults spiek@1:1",
            "sim_publisher run --scenario rigid-body --faults service-kill@1:1",
            "sim_publisher run --scenario rotation --faults bias@1:1,size=1",
            "sim_publisher run --scenario rigid-body --duration 5 --faults stop@5:1",
            "sim_publisher run --scenario auv --table dive.csv",
            "sim_publisher run --scenario auv --duration 9 --table dive.csv --faults kill@1:1",
            "sim_publisher replay --format acsl /no/such.log",
            "sim_publisher replay --format acsl /no/such.log --column time_s=t",
            "sim_publisher replay --format csv /no/such.csv --speed 0",
            "sim_publisher replay --format csv /no/such.csv --speed NaN",
            "sim_publisher mavlink",
            "sim_publisher mavlink --listen udp:14550",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --thrust-n 0",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --join-ms NaN",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --send-to 127.0.0.1:1",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --silent --send odometry",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --system-id 0",
            "sim_publisher mavlink --listen serial:/dev/null --send odometry --send-to 127.0.0.1:1",
        ] {
            assert_eq!(code_of(line), ExitCode::from(2), "{line}");
        }
        assert_eq!(code_of("sim_publisher --version"), ExitCode::SUCCESS);
    }
}
