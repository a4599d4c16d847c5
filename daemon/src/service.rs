//! Starts and stops the service: its threads, the order of their start and end, and its files.

use crate::assemble;
use crate::check;
use crate::config::{ConfigError, ConfigFile, RealTimeConfig, Trigger};
use crate::cycle::{Cycle, LoopRings};
use crate::engine::Engine;
use crate::log::say;
use crate::ports::{HousekeepingPorts, LoopPorts, PortsError};
use crate::sensor_clocks::SensorClocks;
use crate::snapshot::{self, SnapshotError, SnapshotLock};
use crate::system::real_time::allowed_cores;
use crate::system::settings::{self, OffTheLoop, Outcome};
use crate::threads::housekeeping::{Housekeeping, HousekeepingRings};
use crate::threads::recorder::{self, RecorderRing};
use crate::threads::snapshot_writer;
use flight_record::{OtherVersion, VERSION};
use shared_types::domain::InstanceClaim;
use shared_types::service::{ServiceError, check_instance_name};
use shared_types::{Domain, DomainError, Status};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// At the end the service waits this long for the disk; then it stops without what was not written.
const WRITERS_PATIENCE: Duration = Duration::from_secs(10);
/// Tick records on their way to the housekeeping thread: more than a second of them at any usual rate.
const MAX_RECORDS: usize = 8192;

/// Why the service did not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The configuration was refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Shared memory was refused.
    #[error(transparent)]
    Ports(#[from] PortsError),
    /// The snapshot was refused.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// The flight record cannot be written.
    #[error(
        "flight record '{path}': {cause}; needed: --record with a new file or a record, in a directory that is there and can be written to"
    )]
    Record {
        /// The file.
        path: String,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// The flight record exists, in another version of the layout.
    #[error(
        "flight record '{path}' has version {found}, this program appends to version {VERSION}; needed: another --record FILE"
    )]
    RecordVersion {
        /// The file.
        path: String,
        /// Its version's digit.
        found: char,
    },
    /// A thread could not be started, or ended at once.
    #[error("the {0} thread did not start")]
    Thread(&'static str),
    /// The system refused what `real_time.required` asks for.
    #[error(
        "real-time settings are required (--require-real-time, real_time.required) and refused: {0}; see all with daemon doctor"
    )]
    RealTime(String),
}

impl From<DomainError> for StartError {
    fn from(error: DomainError) -> Self {
        Self::Ports(error.into())
    }
}

impl StartError {
    /// The record at `path` cannot be appended to.
    fn record(path: &Path, cause: std::io::Error) -> Self {
        let path = path.display().to_string();
        match OtherVersion::in_error(&cause) {
            Some(OtherVersion { found }) => Self::RecordVersion { path, found },
            None => Self::Record { path, cause },
        }
    }

    /// Whether the command line or the configuration is at fault, not the machine.
    pub fn is_wrong_usage(&self) -> bool {
        matches!(
            self,
            Self::Config(_)
                | Self::RecordVersion { .. }
                | Self::Snapshot(SnapshotError::OtherDesign(..) | SnapshotError::OtherVersion(..))
                | Self::Ports(PortsError::Service(ServiceError::InstanceName(_)))
        )
    }
}

/// Which files a service reads and writes; none by default.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ServiceFiles {
    /// Directory of the snapshots; without it what was learned is lost when the service ends.
    pub state: Option<PathBuf>,
    /// Begin anew; an old snapshot is kept under another name.
    pub is_fresh: bool,
    /// Flight record, appended to.
    pub record: Option<PathBuf>,
}

impl ServiceFiles {
    /// The snapshot of an instance. The domain is part of its name, so that equally named instances of two domains have different files.
    pub fn snapshot_in(state: &Path, domain: &Domain, instance: &str) -> PathBuf {
        state.join(format!("{}{instance}.snapshot", domain.prefix()))
    }
}

/// A running service: the loop's thread, the housekeeping thread, and one thread for each file that is written.
#[derive(Debug)]
pub struct Service {
    domain: Domain,
    claim: Option<InstanceClaim>,
    snapshot_lock: Option<SnapshotLock>,
    stop_loop: Arc<AtomicBool>,
    stop_writers: Arc<AtomicBool>,
    stop_housekeeping: Arc<AtomicBool>,
    loop_thread: Option<JoinHandle<()>>,
    writer_threads: Vec<JoinHandle<()>>,
    housekeeping_thread: Option<JoinHandle<Status>>,
}

impl Service {
    /// Starts the service of `instance` and returns once all its services exist.
    ///
    /// # Errors
    /// The configuration or the snapshot is refused, the instance is taken, or shared memory or a file cannot be used;
    /// nothing runs then.
    pub fn start(
        config: &ConfigFile,
        domain: &Domain,
        instance: &str,
        files: &ServiceFiles,
    ) -> Result<Self, StartError> {
        let estimator = assemble::estimator(config)?;
        check::local_solvers(&estimator).iter().for_each(|sentence| say!("{sentence}"));
        check::unproven(config, &estimator).iter().for_each(|sentence| say!("warning: {sentence}"));
        check::time_of_step(&estimator).map_or(Ok(()), |step| check::fits(config, &step))?;
        config.check_cores(&allowed_cores())?;
        let config = config.config.clone();
        check_instance_name(instance).map_err(PortsError::from)?;
        if config.real_time.required {
            // Before anything is made in shared memory.
            nothing_refused(&settings::try_out(&config.real_time))?;
        }
        // The threads started from here on inherit this; the loop moves to its own cores.
        let _off_the_loop = OffTheLoop::of_calling_thread(&config.real_time)
            .map_err(|refused| say!("warning: helpers stay on the loop's cores: {refused}"));
        // From here on no other service uses the snapshot.
        let claim = domain.claim_instance(instance)?;

        let mut engine = Engine::new(&config, estimator);
        let snapshot = files.state.as_ref().map(|state| ServiceFiles::snapshot_in(state, domain, instance));
        let snapshot_lock = snapshot.as_deref().map(SnapshotLock::take).transpose()?;
        let (checkpoint, restored) = match &snapshot {
            Some(path) => snapshot::take_over(path, files.is_fresh, &config, &mut engine)?,
            None => Default::default(),
        };
        let (snapshots, saver) =
            snapshot_writer::saver(snapshot, instance, &config, (engine.n_learned(), files.is_fresh));
        let mut recorder_ring = RecorderRing::none();
        let mut recorder = None;
        let mut record_progress = None;
        if let Some(path) = &files.record {
            let session = recorder::session(&config, instance, checkpoint.as_ref());
            let (ring, writer, progress) =
                recorder::recorder(path, &session, config.rate_hz, crate::limits::MAX_SAMPLES_PER_TICK)
                    .map_err(|cause| StartError::record(path, cause))?;
            recorder_ring = ring;
            (recorder, record_progress) = (Some(writer), Some(progress));
        }
        drop(checkpoint);

        let (records_in, records_out) = rtrb::RingBuffer::new(MAX_RECORDS);
        let (commands_in, commands_out) = rtrb::RingBuffer::new(8);
        let loop_rings =
            LoopRings { records: records_in, commands: commands_out, recorder: recorder_ring, snapshots };
        let (saver, saver_handle) = saver.unzip();
        let housekeeping_rings = HousekeepingRings {
            records: records_out,
            commands: commands_in,
            saver: saver_handle,
            record_progress,
        };

        let mut service = Self {
            domain: domain.clone(),
            claim: Some(claim),
            snapshot_lock,
            stop_loop: Arc::default(),
            stop_writers: Arc::default(),
            stop_housekeeping: Arc::default(),
            loop_thread: None,
            writer_threads: Vec::new(),
            housekeeping_thread: None,
        };
        let config_of_status = config.clone();
        let real_time: Arc<OnceLock<Outcome>> = Arc::default();
        let seen = Arc::clone(&real_time);
        let stop = Arc::clone(&service.stop_housekeeping);
        service.housekeeping_thread =
            Some(spawn_with("housekeeping", domain, instance, HousekeepingPorts::make, move |ports| {
                Housekeeping::new(ports, housekeeping_rings, &config_of_status, restored)
                    .with_real_time(seen)
                    .run(&stop)
            })?);
        if let Some(saver) = saver {
            let stop = Arc::clone(&service.stop_writers);
            service.writer_threads.push(spawn("saver", move || saver.run(&stop))?);
        }
        if let Some(recorder) = recorder {
            let stop = Arc::clone(&service.stop_writers);
            service.writer_threads.push(spawn("recorder", move || recorder.run(&stop))?);
        }
        let stop = Arc::clone(&service.stop_loop);
        let (settled, settings) = mpsc::sync_channel(1);
        let asked = config.real_time.clone();
        let polls = config.trigger == Trigger::Sample;
        service.loop_thread = Some(spawn_with("loop", domain, instance, LoopPorts::make, move |ports| {
            let clocks = SensorClocks::new(&config.sensor);
            let mut cycle = Cycle::new(engine, clocks, ports, loop_rings);
            // Now everything that a tick uses exists, so all of it is locked, and set-up does not run at the priority.
            let (outcome, _held) = settings::apply(&config.real_time);
            let _ = settled.send(outcome);
            cycle.run(&config, &stop);
        })?);
        let outcome = settings.recv().map_err(|_| StartError::Thread("loop"))?;
        say_real_time(&asked, polls, &outcome);
        if asked.required {
            nothing_refused(&outcome)?;
        }
        let _ = real_time.set(outcome);
        Ok(service)
    }

    /// Finishes the tick, saves what was learned, removes the services, and returns the last status.
    pub fn stop(mut self) -> Status {
        self.finish().unwrap_or_default()
    }

    /// Whether all threads still run; a thread ends by itself only because of a defect.
    pub fn is_running(&self) -> bool {
        self.loop_thread.as_ref().is_some_and(|thread| !thread.is_finished())
            && self.writer_threads.iter().all(|thread| !thread.is_finished())
            && self.housekeeping_thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    fn finish(&mut self) -> Option<Status> {
        self.stop_loop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.loop_thread.take() {
            let _ = thread.join();
        }
        // The writers end after the loop, which hands over its last data.
        self.stop_writers.store(true, Ordering::Release);
        let deadline = Instant::now() + WRITERS_PATIENCE;
        for thread in self.writer_threads.drain(..) {
            while !thread.is_finished() && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(2));
            }
            match thread.is_finished() {
                true => drop(thread.join()),
                false => say!(
                    "warning: the {} does not come to an end: its disk hangs; what it had not written is lost",
                    thread.thread().name().unwrap_or("writer")
                ),
            }
        }
        // Housekeeping ends last: its last status covers the last tick.
        self.stop_housekeeping.store(true, Ordering::Relaxed);
        let status = self.housekeeping_thread.take().and_then(|thread| thread.join().ok());
        (self.claim, self.snapshot_lock) = (None, None);
        // A domain still in use, or locked by a starting process, stays.
        let _ = self.domain.remove_if_unused();
        status
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.finish();
    }
}

fn spawn(name: &'static str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, StartError> {
    let thread = std::thread::Builder::new().name(format!("daemon-{name}")).spawn(work);
    thread.map_err(|_| StartError::Thread(name))
}

fn nothing_refused(outcome: &Outcome) -> Result<(), StartError> {
    let refused: Vec<_> = outcome.refused.iter().map(|(_, refused)| refused.to_string()).collect();
    if refused.is_empty() { Ok(()) } else { Err(StartError::RealTime(refused.join("; "))) }
}

/// Logs what was granted, and each refusal with its reason and remedy.
fn say_real_time(asked: &RealTimeConfig, polls: bool, outcome: &Outcome) {
    say!("real time: {}", outcome.found.join(", "));
    let nothing = RealTimeConfig { required: true, ..RealTimeConfig::default() };
    if *asked == nothing {
        say!(
            "warning: real-time settings are required, and [real_time] asks for none: punctual timers are all there is"
        );
    }
    for (_, refused) in &outcome.refused {
        say!("warning: real time: {refused}");
    }
    if asked.priority.is_some()
        && polls
        && let Some(found) = settings::throttling()
    {
        say!(
            "warning: polling at a fixed priority, and {found}: the kernel may stop the loop for the rest; \
              give it a core of its own, then sysctl -w kernel.sched_rt_runtime_us=-1"
        );
    }
}

/// Starts a thread that makes its ports itself, since they stay on the thread that makes them, and waits
/// until it has.
fn spawn_with<Ports: 'static, T: Send + Default + 'static>(
    name: &'static str,
    domain: &Domain,
    instance: &str,
    make: fn(&Domain, &str) -> Result<Ports, PortsError>,
    work: impl FnOnce(Ports) -> T + Send + 'static,
) -> Result<JoinHandle<T>, StartError> {
    let (domain, instance) = (domain.clone(), instance.to_owned());
    let (ready, made) = mpsc::sync_channel(1);
    let thread = std::thread::Builder::new().name(format!("daemon-{name}")).spawn(move || {
        match make(&domain, &instance) {
            Ok(ports) => {
                let _ = ready.send(Ok(()));
                work(ports)
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                T::default()
            }
        }
    });
    let thread = thread.map_err(|_| StartError::Thread(name))?;
    made.recv().map_err(|_| StartError::Thread(name))??;
    Ok(thread)
}
