//! `sim_publisher run --sensors`: sensors of several processes, or of one that publishes for all of them.

use super::target::{Failure, TargetArgs, publish_source, report};
use crate::publish::{Pace, Published};
use crate::sensor_set::SensorSet;
use crate::supervise::end_with_supervisor;
use clap::Args;
use shared_types::clock::monotonic_ns;
use shared_types::logln;
use std::ffi::OsString;
use std::process::{Child, Command, Stdio};

/// From the start of the processes to the first stamp (ns): each has to find the service.
const LEAD_NS: u64 = 1_000_000_000;

/// How a set of sensors is published.
#[derive(Debug, Args)]
pub(super) struct SetArgs {
    /// With --sensors: each in a process of its own, instead of a publisher of its own
    #[arg(long, requires = "sensors", conflicts_with = "only")]
    processes: bool,
    /// With --sensors: this one alone
    #[arg(long, value_name = "NAME", requires = "sensors")]
    only: Option<String>,
    /// The start that the processes of all sensors share
    #[arg(long, hide = true, requires = "only")]
    start_ns: Option<u64>,
}

/// Publishes a set for this long (s), with this seed.
pub(super) fn run_set(
    name: &str,
    args: &SetArgs,
    (duration_s, seed): (Option<f64>, u64),
    target: &TargetArgs,
) -> Result<(), Failure> {
    let set = SensorSet::read(name)?;
    let known = || set.sensor.iter().map(|sensor| sensor.name.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(only) = &args.only
        && set.sensor.iter().all(|sensor| sensor.name != *only)
    {
        return Err(Failure::Usage(format!("--only {only}: needed: one of {}", known())));
    }
    let published = match args.processes {
        true => run_processes(&set)?,
        false => publish_set(&set, name, args, (duration_s, seed), target)?,
    };
    let details = [("sensors", name.into()), ("rate_hz", set.rate_hz.into()), ("seed", seed.into())];
    report(target, &published, details);
    Ok(())
}

fn publish_set(
    set: &SensorSet,
    name: &str,
    args: &SetArgs,
    (duration_s, seed): (Option<f64>, u64),
    target: &TargetArgs,
) -> Result<Published, Failure> {
    if args.start_ns.is_some() {
        end_with_supervisor();
    }
    let only = args.only.as_ref();
    let place = only.and_then(|only| set.sensor.iter().position(|sensor| sensor.name == *only));
    let flight = set.fly(duration_s, seed)?.filter_map(|mut outgoing| match place {
        None => Some(outgoing),
        Some(place) => {
            // Of several processes, that of the first sensor tells the truth.
            outgoing.truth = outgoing.truth.filter(|_| place == 0);
            outgoing.delivery = outgoing.delivery.filter(|delivery| delivery.source == place);
            if let Some(delivery) = &mut outgoing.delivery {
                delivery.source = 0;
            }
            (outgoing.truth.is_some() || outgoing.delivery.is_some()).then_some(outgoing)
        }
    });
    let n_sources = if only.is_some() { 1 } else { set.sensor.len() };
    let of = only.map_or(format!("{n_sources} sensors"), |only| format!("sensor '{only}'"));
    let what = format!("{of} of '{name}', scenario '{}', seed {}", set.scenario.name(), seed);
    let pace = Pace { n_sources, resumed_start_ns: args.start_ns, ..Pace::live() };
    publish_source(target, &what, flight, pace, |_| ())
}

/// This program once for each sensor, with the same start.
fn run_processes(set: &SensorSet) -> Result<Published, Failure> {
    let start_ns = monotonic_ns() + LEAD_NS;
    let program = std::env::current_exe()?;
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let start = |sensor: &str| {
        let arguments =
            arguments.iter().filter(|argument| *argument != "--processes" && *argument != "--json");
        let mut command = Command::new(&program);
        command.args(arguments).args(["--json", "--only", sensor, "--start-ns", &start_ns.to_string()]);
        command.stdout(Stdio::piped()).spawn()
    };
    let sensors = set.sensor.iter();
    let processes: Vec<(&str, Child)> = sensors
        .map(|sensor| start(&sensor.name).map(|process| (sensor.name.as_str(), process)))
        .collect::<Result<_, _>>()?;
    logln!("{} sensors, each in a process of its own", processes.len());
    let mut all = Published { start_stamp_ns: start_ns, ..Published::default() };
    // One after the other, to their ends: an early end of one is no reason to stop the others' flight.
    let mut failed = None;
    for (name, process) in processes {
        let output = process.wait_with_output()?;
        match serde_json::from_slice::<Published>(&output.stdout) {
            Ok(published) => all.add(&published),
            Err(_) => failed = Some(format!("the process of sensor '{name}' ended early: {}", output.status)),
        }
    }
    match failed {
        None => Ok(all),
        Some(what) => Err(Failure::Worker(what)),
    }
}
