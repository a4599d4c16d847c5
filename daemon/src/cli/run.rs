//! `daemon run`: runs the service until SIGINT or SIGTERM.

use super::arguments::{DesignArguments, PlaceArguments};
use crate::config::ConfigFile;
use crate::log::say;
use crate::service::{Service, ServiceFiles};
use crate::snapshot;
use crate::system::service_manager;
use crate::system::settings::OffTheLoop;
use crate::system::state_directory::{STATE_VARIABLE, state_directory};
use anyhow::Context;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

#[derive(Debug, Args)]
pub(super) struct RunArguments {
    #[command(flatten)]
    design: DesignArguments,
    #[command(flatten)]
    real_time: RealTimeArguments,
    #[command(flatten)]
    place: PlaceArguments,
    #[command(flatten)]
    files: FileArguments,
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
                // The default directory was not asked for: the service runs without it.
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

/// Runs the service until a signal ends it.
pub(super) fn run(arguments: &RunArguments) -> anyhow::Result<()> {
    let RunArguments { design, real_time, place, files } = arguments;
    let mut config = design.read()?;
    real_time.change(&mut config);
    let domain = place.domain()?;
    let files = files.files()?;
    let stop = command_line::stop_flag()?;
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
        status.counters.ticks,
        status.counters.samples_accepted,
        status.counters.samples_lost,
        status.counters.samples_rejected_total(),
        status.counters.deadline_misses
    );
    Ok(())
}
