//! `sim_publisher run`: simulates a vehicle with its sensors and faults.

use super::arguments::parse_axes;
use super::run_set::{SetArgs, run_set};
use super::target::{Failure, TargetArgs, publish_source, report};
use crate::delivery::Outgoing;
use crate::faults::{Fault, Faults, Faulty, Reach, Tally, check_faults, read_faults};
use crate::publish::{Pace, Published};
use crate::scenario::Scenario;
use crate::sensor_set::SENSOR_SETS;
use crate::sensors::Outage;
use crate::simulation::{DEFAULT_RATE_HZ, Simulation, SimulationOptions};
use crate::supervise::{self, Message, Supervised, supervise};
use clap::Args;
use command_line::stop_flag;
use importers::write_table;
use shared_types::outln;
use std::cell::Cell;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// Which vehicle
    #[arg(long, value_enum, required_unless_present = "sensors")]
    scenario: Option<Scenario>,
    #[arg(long, value_name = "NAME|FILE", help = sensors_help(), conflicts_with_all = [
        "scenario", "rate_hz", "velocity_noise_m_s", "angular_velocity_noise_rad_s", "velocity_bias_m_s",
        "jitter_us", "dropout_probability", "outage", "position_fix_hz", "calm", "faults", "table",
    ])]
    sensors: Option<String>,
    #[command(flatten)]
    set: SetArgs,
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
    /// Since when, after the start, no worker published
    #[arg(long, hide = true, default_value_t = u64::MAX)]
    dead_since_ns: u64,
    #[command(flatten)]
    target: TargetArgs,
}

fn sensors_help() -> String {
    let names = SENSOR_SETS.map(|(name, _)| name).join(", ");
    format!(
        "Sensors of several processes, each with its rate, delay and place: a built-in set ({names}), or a file like it"
    )
}

fn options(args: &RunArgs, scenario: Scenario) -> SimulationOptions {
    SimulationOptions {
        scenario,
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

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    if let Some(name) = &args.sensors {
        return run_set(name, &args.set, (args.duration, args.seed), &args.target);
    }
    let Some(scenario) = args.scenario else { return Err(Failure::Usage("--scenario or --sensors".into())) };
    let options = options(args, scenario);
    let simulation = Simulation::new(&options)?;
    let faults = faults(args, &options)?;
    if let Some(path) = &args.table {
        return write_samples(path, simulation, &faults, args);
    }
    let (name, rate_hz, seed) = (scenario.name(), args.rate_hz, args.seed);
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

/// Publishes as a worker, and reports to the supervisor when it starts, and how many samples were lost since the last one died.
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

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: RunArgs,
    }

    #[test]
    fn options_reach_the_simulation() {
        let line = "run --scenario rigid-body --duration 2.5 --rate-hz 100 --seed 9 \
            --velocity-noise-m-s 0.1 --angular-velocity-noise-rad-s 0.2 --velocity-bias-m-s -0.1,0,0.3 \
            --jitter-us 50 --dropout-probability 0.1 --outage 1:0.5 --outage 2:.25 --position-fix-hz 5 --calm";
        let args = Line::parse_from(line.split_whitespace()).args;
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
        assert_eq!(options(&args, args.scenario.unwrap()), expected);
        let args = Line::parse_from(["run", "--scenario", "auv"]).args;
        assert_eq!(options(&args, Scenario::Auv), SimulationOptions::of(Scenario::Auv));
    }
}
