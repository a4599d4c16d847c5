//! `sim_publisher dvl`: publishes the reports of a Doppler log as samples.

use super::target::{Failure, TargetArgs, connected};
use crate::dvl::{DvlCounts, Options, Origin, TcpAddress, run};
use clap::Args;
use command_line::stop_flag;
use shared_types::{logln, outln};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct DvlArgs {
    /// The log's own server: tcp:HOST[:PORT]
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["listen", "replay"])]
    connect: Option<TcpAddress>,
    /// Wait there for a program that forwards the log's lines: tcp:ADDRESS[:PORT]
    #[arg(long, value_name = "ADDRESS", conflicts_with = "replay")]
    listen: Option<TcpAddress>,
    /// Lines that --record has written, at the pace of their times
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Number of its [[sensor]] in the service's configuration: lever arm, mounting
    #[arg(long, value_name = "N", default_value_t = 0)]
    sensor: u32,
    /// The least deviation of a velocity: the log's own is that of its noise alone
    #[arg(long, value_name = "M_S", default_value_t = 0.005)]
    least_std_m_s: f64,
    /// Write every line to this file
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    record: Option<PathBuf>,
    /// Length of the run in s [default: until Ctrl-C]
    #[arg(long, visible_alias = "duration", value_name = "S")]
    duration_s: Option<f64>,
    #[command(flatten)]
    target: TargetArgs,
}

pub(super) fn dvl(args: &DvlArgs) -> Result<(), Failure> {
    if !(args.least_std_m_s.is_finite() && args.least_std_m_s >= 0.0) {
        let found = args.least_std_m_s;
        return Err(Failure::Usage(format!("--least-std-m-s {found}: needed: a finite number, 0 or more")));
    }
    let origins = [
        args.connect.clone().map(Origin::Connect),
        args.listen.clone().map(Origin::Listen),
        args.replay.clone().map(Origin::Replay),
    ];
    let Some(origin) = origins.into_iter().flatten().next() else {
        return Err(Failure::Usage("no log; needed: --connect, --listen or --replay".into()));
    };
    let options = Options {
        origin,
        sensor: args.sensor,
        least_std_m_s: args.least_std_m_s,
        record: args.record.clone(),
        duration_s: args.duration_s,
    };
    let stop = stop_flag()?;
    let Some((domain, client)) = connected(&args.target, &stop)? else { return Ok(()) };
    logln!("publishing to instance '{}' in {}: a Doppler log", args.target.instance, domain.root().display());
    let counts = run(&client, &options, &stop)?;
    drop(client);
    domain.remove_if_unused()?;
    if args.target.json {
        outln!("{}", serde_json::to_value(counts).expect("numbers"));
        return Ok(());
    }
    let DvlCounts {
        samples_published, without_bottom_lock, other_lines, unreadable_lines, connections, ..
    } = counts;
    outln!(
        "{samples_published} samples published, {without_bottom_lock} reports without bottom lock, {other_lines} other \
         lines, {unreadable_lines} unreadable; {connections} connections"
    );
    Ok(())
}
