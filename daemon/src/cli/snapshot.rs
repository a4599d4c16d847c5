//! `daemon snapshot show`: prints the contents of a snapshot.

use crate::snapshot::Snapshot;
use clap::{Args, Subcommand};
use comfy_table::{Table, presets::NOTHING};
use shared_types::outln;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

pub(super) const SNAPSHOT_EXAMPLES: &str = "\
Examples:
  daemon snapshot show ~/.local/state/observer/*vehicle.snapshot
  daemon snapshot show vehicle.snapshot --json";

#[derive(Debug, Args)]
pub(super) struct SnapshotArguments {
    #[command(subcommand)]
    task: SnapshotTask,
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

/// Runs `daemon snapshot`.
pub(super) fn run(arguments: &SnapshotArguments) -> anyhow::Result<()> {
    let SnapshotTask::Show { file, json } = &arguments.task;
    show(file, *json)
}

fn show(file: &Path, json: bool) -> anyhow::Result<()> {
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
    let learned = &snapshot.checkpoint.learned;
    let nonzero = learned.iter().filter(|number| **number != 0.0).count();
    fact("learned", format!("{} numbers, {nonzero} of them not zero", learned.len()));
    let states = snapshot.checkpoint.state.map(|state| state.estimator.channels);
    let numbers = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(" ");
    for state in states.iter().flatten().flatten() {
        if let Some((position, velocity)) = state.position_and_velocity() {
            fact("position (m)", numbers(position.as_slice()));
            fact("velocity (m/s)", numbers(velocity.as_slice()));
        }
        if let Some((attitude, angular_velocity)) = state.attitude_and_angular_velocity() {
            fact("attitude wxyz", numbers(&[attitude.w, attitude.i, attitude.j, attitude.k]));
            fact("angular velocity (rad/s)", numbers(angular_velocity.as_slice()));
        }
        if let Some(state) = state.linear_state() {
            fact("state", numbers(state.as_slice()));
        }
    }
    for (key, value) in snapshot.meaning {
        fact(&key, value);
    }
    outln!("{facts}");
    Ok(())
}
