//! All facts of a machine and its wake-up lateness, as one report.

use super::fact::{Fact, Plan};
use super::lateness::LatenessRow;
use super::{disk, facts, lateness, memory};
use crate::config::{ConfigFile, RealTimeConfig};
use crate::system::real_time::allowed_cores;
use crate::system::{machine, settings};
use serde::Serialize;
use shared_types::Domain;
use shared_types::payload::real_time;

/// The document of `--json`.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) cpu: String,
    pub(crate) profile: &'static str,
    pub(crate) rate_hz: f64,
    pub(crate) spin_us: f64,
    pub(crate) priority: u8,
    pub(crate) facts: Vec<Fact>,
    pub(crate) lateness: Vec<LatenessRow>,
}

/// Measures this machine; with a configuration, tries out its real-time settings, too.
pub(crate) fn report(plan: &Plan, domain: &Domain, instance: &str, file: Option<&ConfigFile>) -> Report {
    let steal_before = facts::processor_time();
    let lateness = lateness::measure(plan);
    let mut facts = facts::all(plan, steal_before);
    facts.extend(memory::all(domain, instance));
    facts.push(disk::snapshots());
    if let Some(file) = file {
        facts.push(asked_for(file, &file.config.real_time));
    }
    Report {
        cpu: machine::cpu_model().unwrap_or_else(|| "unknown CPU".into()),
        profile: if cfg!(debug_assertions) { "debug" } else { "release" },
        rate_hz: plan.rate_hz,
        spin_us: plan.spin_us,
        priority: plan.priority,
        facts,
        lateness,
    }
}

/// Whether this machine grants what a configuration asks for.
fn asked_for(file: &ConfigFile, asked: &RealTimeConfig) -> Fact {
    const NAME: &str = "settings of the configuration";
    if let Err(error) = file.check_cores(&allowed_cores()) {
        return Fact::bad(NAME, error.to_string(), "change that key: daemon run refuses it on this machine");
    }
    let outcome = settings::try_out(asked);
    let granted = format!("granted: {}", real_time::words(outcome.granted).join(", "));
    match outcome.refused.as_slice() {
        [] => Fact::good(NAME, granted),
        refused => {
            let remedies: Vec<_> = refused.iter().map(|(_, refused)| refused.to_string()).collect();
            let found = format!("{granted}; refused: {}", outcome.refused_in_short());
            Fact::bad(NAME, found, remedies.join("; "))
        }
    }
}
