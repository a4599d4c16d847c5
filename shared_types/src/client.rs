//! The client of a vehicle's process or a reader: publish measurements, read estimates, send commands.

use crate::clock::monotonic_ns;
use crate::payload::{Command, Estimate, Measurement, Reply, Status, Truth};
use crate::service::{self, Node, Published, ServiceError, Services};
use domain::{Domain, DomainError};
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
        client.open(|services| services.open::<Estimate>())?;
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

    fn publisher<T: Published>(&self) -> Result<TopicPublisher<T>, ClientError> {
        let topic = self.open(|services| services.open::<T>())?;
        let _making = self.domain.lock_for_making()?;
        let publisher = topic.publisher_builder().create().map_err(port_error("create publisher"))?;
        Ok(TopicPublisher { publisher })
    }

    /// A subscriber that holds this many samples; `None`: as many as the service allows, which another machine's link may
    /// have made with less than ours.
    fn subscriber<T: Published>(
        &self,
        buffer: Option<usize>,
    ) -> Result<Subscriber<ipc::Service, T, ()>, ClientError> {
        let topic = self.open(|services| services.open::<T>())?;
        let _making = self.domain.lock_for_making()?;
        let builder = topic.subscriber_builder();
        let builder = if let Some(buffer) = buffer { builder.buffer_size(buffer) } else { builder };
        builder.create().map_err(port_error("create subscriber"))
    }

    fn stream<T: Published>(&self) -> Result<Stream<T>, ClientError> {
        Ok(Stream { subscriber: self.subscriber(None)? })
    }

    fn latest<T: Published>(&self) -> Result<Latest<T>, ClientError> {
        Ok(Latest { subscriber: self.subscriber(Some(1))?, newest: None })
    }

    /// The source of the vehicle's measurements. An instance listens to one source at a time.
    ///
    /// # Errors
    /// `Service` or `Port` where the service cannot be opened or has no free place; likewise of every other port.
    pub fn measurement_publisher(&self) -> Result<MeasurementPublisher, ClientError> {
        self.publisher()
    }

    /// The true plant's states, from a simulator.
    pub fn truth_publisher(&self) -> Result<TruthPublisher, ClientError> {
        self.publisher()
    }

    /// Every estimate from now on, and the newest one before; the oldest are dropped where a reader is slow.
    pub fn estimate_subscriber(&self) -> Result<Stream<Estimate>, ClientError> {
        self.stream()
    }

    /// The service's status, a few times a second.
    pub fn status_subscriber(&self) -> Result<Stream<Status>, ClientError> {
        self.stream()
    }

    /// Every measurement that a source publishes, for recorders.
    pub fn measurement_subscriber(&self) -> Result<Stream<Measurement>, ClientError> {
        self.stream()
    }

    /// The true plant's states that a simulator publishes.
    pub fn truth_subscriber(&self) -> Result<Stream<Truth>, ClientError> {
        self.stream()
    }

    /// The newest estimate at a glance, without a queue: a look costs a fraction of a microsecond.
    pub fn latest_estimate(&self) -> Result<Latest<Estimate>, ClientError> {
        self.latest()
    }

    /// The newest status at a glance.
    pub fn latest_status(&self) -> Result<Latest<Status>, ClientError> {
        self.latest()
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

/// Publishes on one topic. Never blocks: where a reader is slow, its oldest message is dropped.
#[derive(Debug)]
pub struct TopicPublisher<T: Published> {
    publisher: Publisher<ipc::Service, T, ()>,
}

/// Publishes measurements.
pub type MeasurementPublisher = TopicPublisher<Measurement>;
/// Publishes the true plant's states.
pub type TruthPublisher = TopicPublisher<Truth>;

impl<T: Published> TopicPublisher<T> {
    /// Sends one message; its sequence and stamp are the caller's. Returns how many processes it reached.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    pub fn publish(&self, message: &T) -> Result<usize, ClientError> {
        self.publisher.send_copy(*message).map_err(port_error("publish"))
    }

    /// Lets late readers connect while nothing is published.
    ///
    /// # Errors
    /// `Port` with iceoryx2's reason.
    pub fn update_connections(&self) -> Result<(), ClientError> {
        self.publisher.update_connections().map_err(port_error("update connections"))
    }
}

/// A queue of messages to this reader.
#[derive(Debug)]
pub struct Stream<Payload: Published> {
    subscriber: Subscriber<ipc::Service, Payload, ()>,
}

impl<Payload: Published> Stream<Payload> {
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
                return Err(ClientError::TimedOut { what: Payload::TOPIC, waited_s: patience.as_secs_f64() });
            }
            std::thread::sleep(POLL);
        }
    }
}

/// Reads the newest message of a topic without a queue.
#[derive(Debug)]
pub struct Latest<Payload: Published> {
    subscriber: Subscriber<ipc::Service, Payload, ()>,
    newest: Option<Payload>,
}

impl<Payload: Published> Latest<Payload> {
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
