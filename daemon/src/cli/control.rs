//! `daemon control`: sends a command to a running service and prints its status.

use super::arguments::PlaceArguments;
use crate::system::settings;
use clap::{Args, ValueEnum};
use comfy_table::{Table, presets::NOTHING};
use shared_types::payload::{LatencySummary, Rejection, Status, command, outcome, real_time, restored};
use shared_types::table::PER_CHANNEL;
use shared_types::{Client, ClientError, outln};
use std::time::Duration;

#[derive(Debug, Args)]
pub(super) struct ControlArguments {
    /// What to do.
    action: ControlAction,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: PlaceArguments,
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

/// Runs `daemon control`.
pub(super) fn run(arguments: &ControlArguments) -> anyhow::Result<()> {
    let ControlArguments { action, json, place } = arguments;
    let domain = place.domain()?;
    let answer = (|| {
        let client = Client::connect(&domain, &place.instance, Duration::from_millis(500))?;
        client.command(action.kind(), Duration::from_secs(20))
    })();
    // A domain that only this question has made is taken away again, if it can be.
    let _ = domain.remove_if_unused();
    let reply = answer.map_err(|error: ClientError| anyhow::anyhow!(error))?;
    anyhow::ensure!(reply.outcome == outcome::DONE, "refused: {}", reply.text());
    match (*json, *action) {
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
    let reasons = Rejection::ALL
        .map(|reason| (reason.words().replace(' ', "_"), status.counters.rejected(reason).into()));
    document["samples_rejected"] = serde_json::Value::Object(reasons.into_iter().collect());
    let refused = refused_bits(status)
        .map(|bit| serde_json::json!({ "setting": real_time::words(bit).join(" "), "remedy": settings::remedy(bit) }));
    document["sources"] = serde_json::to_value(status.sources().collect::<Vec<_>>())?;
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
    let source = |pid: u64| if pid == 0 { "none".into() } else { format!("process {pid}") };
    let mut facts = Table::new();
    facts.load_style(NOTHING);
    let mut fact = |name: &str, value: String| {
        facts.add_row([name, &value]);
    };
    fact("running for", format!("{:.1} s", seconds(status.stamp_ns - status.start_stamp_ns)));
    fact("rate", format!("{} Hz", status.rate_millihertz as f64 / 1e3));
    fact("newest sample", format!("sequence {}, {age}", status.newest_sequence));
    for (k, name) in
        PER_CHANNEL.names.iter().enumerate().filter(|(k, _)| status.output_age_ns[*k] != u64::MAX)
    {
        let nis = if status.nis[k] == 0.0 { String::new() } else { format!(", NIS {:.2}", status.nis[k]) };
        fact(
            &format!("newest output of {name}"),
            format!("{:.3} s ago{nis}", seconds(status.output_age_ns[k])),
        );
    }
    fact("source", format!("{}; another: {}", source(status.source_pid), source(status.other_source_pid)));
    fact("adaptation", if status.adaptation_frozen == 1 { "frozen".into() } else { "on".into() });
    let refused = real_time::words(status.real_time_requested & !status.real_time_granted).join(", ");
    let refused = if refused.is_empty() { "nothing".into() } else { refused };
    let granted = real_time::words(status.real_time_granted).join(", ");
    fact("real time", format!("granted: {granted}; refused: {refused}"));
    let (late, most) = (status.late_ticks_in_a_row, status.most_late_ticks_in_a_row);
    fact("late ticks in a row", format!("{late} now, {most} at most"));
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
    fact("flight record", format!("{} ticks", status.ticks_recorded));
    for (name, text) in status.counters.lines() {
        fact(&name, text);
    }
    outln!("{facts}\n");

    let mut sources = Table::new();
    sources.load_style(NOTHING);
    let header =
        ["source", "sensor", "Hz", "age s", "delay ms", "max ms", "used", "late", "lost", "rejected", "NIS"];
    sources.set_header(header);
    for source in status.sources() {
        let process = if source.pid == 0 { "gone".into() } else { format!("process {}", source.pid) };
        let sensor = if source.sensor == 0 { "–".into() } else { source.sensor.to_string() };
        let rate = source.rate_hz().map_or("–".into(), |rate_hz| format!("{rate_hz:.1}"));
        let ms = |ns: u64| format!("{:.1}", ns as f64 / 1e6);
        let counts = [source.accepted, source.late, source.lost, source.rejected].map(|n| n.to_string());
        let age = format!("{:.3}", seconds(source.age_ns));
        let row = [process, sensor, rate, age, ms(source.delay_ns), ms(source.max_delay_ns)];
        let nis = if source.nis == 0.0 { "–".into() } else { format!("{:.2}", source.nis) };
        sources.add_row(row.into_iter().chain(counts).chain([nis]));
    }
    outln!("{sources}\n");

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
