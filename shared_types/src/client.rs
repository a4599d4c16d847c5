//! The vehicle's side: publish measurements, read estimates, send commands.

use crate::clock::monotonic_ns;
use crate::payload::{Command, Estimate, Measurement, Reply, Status, Truth};
use crate::service::{self, Node, ServiceError, Services};
use crate::{Domain, DomainError};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use std::fmt::Debug;
use std::time::{Duration, Instant};

/// Why the vehicle's side failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// A service or the domain cannot be used.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The daemon is not there.
    #[error(
        "no service for instance '{instance}' in {root} after {waited_s:.1} s; start it: daemon run --instance {instance} --root {root}"
    )]
    NoDaemon {
        /// The instance that was asked for.
        instance: String,
        /// The domain's root path.
        root: String,
        /// How long it was waited for (s).
        waited_s: f64,
    },
    /// Nothing came in time.
    #[error("no {what} within {waited_s:.1} s; is the daemon still running? (daemon control status)")]
    TimedOut {
        /// What was waited for.
        what: &'static str,
        /// How long (s).
        waited_s: f64,
    },
    /// A port refused.
    #[error("{action}: {found}")]
    Port {
        /// What was tried.
        action: &'static str,
        /// iceoryx2's reason.
        found: String,
    },
}

impl From<DomainError> for ClientError {
    fn from(error: DomainError) -> Self {
        Self::Service(error.into())
    }
}

fn port_error<E: Debug>(action: &'static str) -> impl FnOnce(E) -> ClientError {
    move |error| ClientError::Port { action, found: format!("{error:?}") }
}

/// How long a waiting reader sleeps between two looks.
const POLL: Duration = Duration::from_micros(50);

/// A process's connection to one instance of the service. Ports stay on the thread that makes them.
#[derive(Debug)]
pub struct Client {
    node: Node,
    domain: Domain,
    instance: String,
    patience: Duration,
}

impl Client {
    /// Connects to the daemon of `instance`; waits up to `patience` for it to start, here and whenever a
    /// port is opened while the daemon is away.
    ///
    /// # Errors
    /// `NoDaemon` after `patience`; `Service` where what exists does not fit (type, version, owner).
    pub fn connect(domain: &Domain, instance: &str, patience: Duration) -> Result<Self, ClientError> {
        service::check_instance_name(instance)?;
        let node = {
            let _making = domain.lock_for_making()?;
            service::node(domain, "client")?
        };
        let client = Self { node, domain: domain.clone(), instance: instance.into(), patience };
        // The last service that the daemon makes.
        client.open(|services| services.open_estimate())?;
        Ok(client)
    }

    /// Opens a service as soon as the daemon has made it.
    fn open<T>(&self, open: impl Fn(&Services<'_>) -> Result<T, ServiceError>) -> Result<T, ClientError> {
        let start = Instant::now();
        let services = Services::of(&self.node, &self.instance)?;
        loop {
            match open(&services) {
                Ok(service) => return Ok(service),
                Err(ServiceError::Missing(_)) if start.elapsed() < self.patience => {
                    std::thread::sleep(Duration::from_millis(10));
                }
                Err(ServiceError::Missing(_)) => return Err(self.no_daemon(start)),
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn no_daemon(&self, since: Instant) -> ClientError {
        ClientError::NoDaemon {
            instance: self.instance.clone(),
            root: self.domain.root().display().to_string(),
            waited_s: since.elapsed().as_secs_f64(),
        }
    }

    fn publisher<Payload: ZeroCopySend + Debug + Copy + 'static>(
        &self,
        topic: service::Topic<Payload>,
    ) -> Result<Publisher<ipc::Service, Payload, ()>, ClientError> {
        let _making = self.domain.lock_for_making()?;
        topic.publisher_builder().create().map_err(port_error("create publisher"))
    }

    fn latest<Payload: ZeroCopySend + Debug + Copy + 'static>(
        &self,
        topic: service::Topic<Payload>,
    ) -> Result<Latest<Payload>, ClientError> {
        let _making = self.domain.lock_for_making()?;
        let subscriber = topic.subscriber_builder().buffer_size(1).create();
        Ok(Latest { subscriber: subscriber.map_err(port_error("create subscriber"))?, newest: None })
    }

    fn stream<Payload: ZeroCopySend + Debug + Copy + 'static>(
        &self,
        what: &'static str,
        topic: service::Topic<Payload>,
    ) -> Result<Stream<Payload>, ClientError> {
        let _making = self.domain.lock_for_making()?;
        let subscriber = topic.subscriber_builder().create().map_err(port_error("create subscriber"))?;
        Ok(Stream { subscriber, what })
    }

    /// The source of the vehicle's measurements. An instance listens to one source at a time.
    ///
    /// # Errors
    /// `Service` or `Port` where the service cannot be opened or has no free place.
    pub fn measurement_publisher(&self) -> Result<MeasurementPublisher, ClientError> {
        Ok(MeasurementPublisher {
            publisher: self.publisher(self.open(|services| services.open_measurement())?)?,
        })
    }

    /// The true plant's states, from a simulator.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn truth_publisher(&self) -> Result<TruthPublisher, ClientError> {
        Ok(TruthPublisher { publisher: self.publisher(self.open(|services| services.open_truth())?)? })
    }

    /// Every estimate from now on, and the newest one before; the oldest are dropped where a reader is slow.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn estimate_subscriber(&self) -> Result<Stream<Estimate>, ClientError> {
        self.stream("estimate", self.open(|services| services.open_estimate())?)
    }

    /// The service's status, a few times a second.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn status_subscriber(&self) -> Result<Stream<Status>, ClientError> {
        self.stream("status", self.open(|services| services.open_status())?)
    }

    /// Every measurement that a source publishes, for recorders.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn measurement_subscriber(&self) -> Result<Stream<Measurement>, ClientError> {
        self.stream("measurement", self.open(|services| services.open_measurement())?)
    }

    /// The true plant's states that a simulator publishes.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn truth_subscriber(&self) -> Result<Stream<Truth>, ClientError> {
        self.stream("truth", self.open(|services| services.open_truth())?)
    }

    /// The newest estimate at a glance, without a queue: a look costs a fraction of a microsecond.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn latest_estimate(&self) -> Result<Latest<Estimate>, ClientError> {
        self.latest(self.open(|services| services.open_estimate())?)
    }

    /// The newest status at a glance.
    ///
    /// # Errors
    /// As [`Client::measurement_publisher`].
    pub fn latest_status(&self) -> Result<Latest<Status>, ClientError> {
        self.latest(self.open(|services| services.open_status())?)
    }

    /// Sends a command (one of [`crate::payload::command`]) and waits for the answer.
    ///
    /// # Errors
    /// `TimedOut` where no daemon answers within `patience`.
    pub fn command(&self, kind: u32, patience: Duration) -> Result<Reply, ClientError> {
        let control = self.open(|services| services.open_control())?;
        let client = {
            let _making = self.domain.lock_for_making()?;
            control.client_builder().create().map_err(port_error("create client"))?
        };
        let pending = client.send_copy(Command { kind, reserved: 0 }).map_err(port_error("send command"))?;
        let start = Instant::now();
        loop {
            if let Some(reply) = pending.receive().map_err(port_error("receive reply"))? {
                return Ok(*reply);
            }
            if start.elapsed() > patience {
                return Err(ClientError::TimedOut { what: "reply", waited_s: start.elapsed().as_secs_f64() });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Publishes measurements. Never blocks: where the daemon is slow, the oldest sample is dropped.
#[derive(Debug)]
pub struct MeasurementPublisher {
    publisher: Publisher<ipc::Service, Measurement, ()>,
}

impl MeasurementPublisher {
    /// Sends one sample; its sequence and stamp are the caller's. Returns how many processes it reached.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    pub fn publish(&self, measurement: &Measurement) -> Result<usize, ClientError> {
        self.publisher.send_copy(*measurement).map_err(port_error("publish measurement"))
    }

    /// Lets late readers connect while nothing is published.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    pub fn update_connections(&self) -> Result<(), ClientError> {
        self.publisher.update_connections().map_err(port_error("update connections"))
    }
}

/// Publishes the true plant's states.
#[derive(Debug)]
pub struct TruthPublisher {
    publisher: Publisher<ipc::Service, Truth, ()>,
}

impl TruthPublisher {
    /// Sends one state.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    pub fn publish(&self, truth: &Truth) -> Result<usize, ClientError> {
        self.publisher.send_copy(*truth).map_err(port_error("publish truth"))
    }
}

/// A queue of messages to this reader.
#[derive(Debug)]
pub struct Stream<Payload: ZeroCopySend + Debug + 'static> {
    subscriber: Subscriber<ipc::Service, Payload, ()>,
    what: &'static str,
}

impl<Payload: ZeroCopySend + Debug + Copy + 'static> Stream<Payload> {
    /// The oldest message not yet taken, or `None`. No allocation, no system call.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    #[inline]
    pub fn take(&mut self) -> Result<Option<Payload>, ClientError> {
        self.take_by(|payload| *payload)
    }

    /// As [`Stream::take`], but `read` sees the message where it lies, and copies what it needs.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    #[inline]
    pub fn take_by<T>(&mut self, read: impl FnOnce(&Payload) -> T) -> Result<Option<T>, ClientError> {
        Ok(self.subscriber.receive().map_err(port_error("receive"))?.map(|sample| read(&sample)))
    }

    /// Waits for the next message; looks every 50 µs.
    ///
    /// # Errors
    /// `TimedOut` after `patience`; `Port` with iceoryx2's reason.
    pub fn wait_next(&mut self, patience: Duration) -> Result<Payload, ClientError> {
        let deadline_ns = monotonic_ns() + patience.as_nanos() as u64;
        loop {
            if let Some(payload) = self.take()? {
                return Ok(payload);
            }
            if monotonic_ns() > deadline_ns {
                return Err(ClientError::TimedOut { what: self.what, waited_s: patience.as_secs_f64() });
            }
            std::thread::sleep(POLL);
        }
    }
}

/// Reads the newest message of a topic without a queue.
#[derive(Debug)]
pub struct Latest<Payload: ZeroCopySend + Debug + 'static> {
    subscriber: Subscriber<ipc::Service, Payload, ()>,
    newest: Option<Payload>,
}

impl<Payload: ZeroCopySend + Debug + Copy + 'static> Latest<Payload> {
    /// The newest message; `None` before the first. No allocation, no system call. Its age is in its
    /// stamp: when the daemon dies, the last one stays.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    #[inline]
    pub fn peek(&mut self) -> Result<Option<Payload>, ClientError> {
        Ok(self.newest()?.copied())
    }

    /// As [`Latest::peek`], without a copy.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    #[inline]
    pub fn newest(&mut self) -> Result<Option<&Payload>, ClientError> {
        while let Some(sample) = self.subscriber.receive().map_err(port_error("receive"))? {
            self.newest = Some(*sample);
        }
        Ok(self.newest.as_ref())
    }
}
