//! What the subcommands share: the target service, the end of a run, and its errors.

use crate::delivery::Outgoing;
use crate::dvl::DvlError;
use crate::faults::FaultError;
use crate::publish::{Pace, Published, connect, publish};
use crate::sensor_set::SensorSetError;
use crate::simulation::SimulationError;
use crate::supervise::SuperviseError;
use clap::Args;
use command_line::stop_flag;
use importers::ImportError;
use shared_types::service::ServiceError;
use shared_types::{Client, ClientError, Domain, DomainError, logln, outln};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Args)]
pub(super) struct TargetArgs {
    /// Which service to feed
    #[arg(long, value_name = "NAME", default_value = "vehicle")]
    pub(super) instance: String,
    /// Root path of the shared memory's domain [default: $OBSERVER_ROOT, else the user's own]
    #[arg(long, value_name = "PATH")]
    pub(super) root: Option<PathBuf>,
    /// Print one JSON document instead of a line
    #[arg(long)]
    pub(super) json: bool,
}

/// Why the program ends without having done its work.
#[derive(Debug, thiserror::Error)]
pub(super) enum Failure {
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
    #[cfg(feature = "mavlink")]
    #[error(transparent)]
    Mavlink(#[from] mavlink_bridge::MavlinkError),
    #[error(transparent)]
    SensorSet(#[from] SensorSetError),
    #[error(transparent)]
    Dvl(#[from] DvlError),
    #[error("{0}")]
    Worker(String),
    #[error("{0}")]
    Usage(String),
    #[error("cannot write '{path}': {cause}")]
    Table { path: String, cause: std::io::Error },
    #[error("cannot listen to signals: {0}")]
    Signals(#[from] std::io::Error),
}

impl Failure {
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Client(ClientError::Service(ServiceError::InstanceName(_))) => 2,
            // The worker has logged the reason.
            Self::Supervise(SuperviseError::Ended(code)) => u8::try_from(*code).unwrap_or(1),
            #[cfg(feature = "mavlink")]
            Self::Mavlink(_) => 1,
            Self::Client(_)
            | Self::Signals(_)
            | Self::Supervise(_)
            | Self::Worker(_)
            | Self::Dvl(_)
            | Self::Table { .. } => 1,
            Self::SensorSet(_)
            | Self::Simulation(_)
            | Self::Faults(_)
            | Self::Import(_)
            | Self::Domain(_)
            | Self::Usage(_) => 2,
        }
    }
}

/// The service of this instance, once it is there; `None` where a stop came first.
pub(super) fn connected(target: &TargetArgs, stop: &AtomicBool) -> Result<Option<(Domain, Client)>, Failure> {
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
pub(super) fn publish_source(
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

/// Prints what was published.
pub(super) fn report<const N: usize>(
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
    let mut document = serde_json::to_value(published).expect("numbers");
    document["duration_s"] = duration_s.into();
    for (key, value) in details {
        document[key] = value;
    }
    outln!("{document}");
}
