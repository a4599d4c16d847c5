//! Names and qualities of the iceoryx2 services: how the daemon creates a service and how other processes open it.
//!
//! Only the daemon creates services. All other processes open them, and wait until they exist.
//!
//! [`Published`] has the table of topics. `NAME/control` is a request-response service: [`Command`] from an operator,
//! [`Reply`] from the daemon.
//!
//! A reader that needs only the newest estimate subscribes with a buffer of one, in which a new message replaces the old
//! one. A blackboard would be the obvious means. But in iceoryx2 0.10.0 an entry whose writer was killed cannot be written
//! again while any reader lives (upstream issue 2008), and readers cannot distinguish such an estimate from a live one.

use crate::payload::{Command, Estimate, Measurement, Reply, Status, Truth};
use domain::{Domain, DomainError};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{publish_subscribe, request_response};
use std::fmt::Debug;

/// Samples that wait for a slow daemon; then the oldest is dropped and shows as a gap in the sequence.
pub const MEASUREMENT_BUFFER: usize = 64;
/// Estimates that wait for a slow reader.
pub const ESTIMATE_BUFFER: usize = 256;
/// Readers of one instance, of each kind: programs, recorders, monitors.
pub const MAX_READERS: usize = 32;
/// Sources of one instance, whether used or refused.
pub const MAX_SOURCES: usize = 16;
/// Processes (nodes) that use one service.
pub(crate) const MAX_NODES: usize = 64;

/// A payload that is published, and the qualities of its service.
pub trait Published: ZeroCopySend + Debug + Copy + 'static {
    /// What follows the instance in the service's name: `NAME/estimate`.
    const TOPIC: &'static str;
    /// Publishers at once.
    const MAX_PUBLISHERS: usize;
    /// Messages that wait for a slow reader; then the oldest is dropped.
    const BUFFER: usize;
    /// Older messages that a new reader gets.
    const HISTORY: usize;
}

macro_rules! published {
    ($($(#[$doc:meta])+ $payload:ident: $topic:literal, $publishers:expr, $buffer:expr, $history:literal;)+) => {$(
        $(#[$doc])+
        impl Published for $payload {
            const TOPIC: &'static str = $topic;
            const MAX_PUBLISHERS: usize = $publishers;
            const BUFFER: usize = $buffer;
            const HISTORY: usize = $history;
        }
    )+};
}

// Topic, publishers, buffer, history.
published! {
    /// Vehicle → daemon.
    Measurement: "measurement", MAX_SOURCES, MEASUREMENT_BUFFER, 0;
    /// Daemon → any reader.
    Estimate: "estimate", 2, ESTIMATE_BUFFER, 1;
    /// Daemon → operators, a few times a second.
    Status: "status", 2, 8, 1;
    /// Simulator → bench, monitor.
    Truth: "truth", MAX_SOURCES, ESTIMATE_BUFFER, 0;
}

/// A node of this process in a domain.
pub type Node = iceoryx2::node::Node<ipc::Service>;
/// Ports of a publish-subscribe service.
pub type Topic<Payload> = publish_subscribe::PortFactory<ipc::Service, Payload, ()>;
/// Ports of the control service.
pub type Control = request_response::PortFactory<ipc::Service, Command, (), Reply, ()>;

/// Why a service cannot be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The domain cannot be used.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The name cannot be part of a service name.
    #[error("instance '{0}': needed: 1 to 32 letters, digits, '-' or '_'")]
    InstanceName(String),
    /// iceoryx2 refused.
    #[error("{action} '{name}': {found}; {remedy}")]
    Refused {
        /// What was tried.
        action: &'static str,
        /// On which service or node.
        name: String,
        /// iceoryx2's reason.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The service was not made yet.
    #[error("service '{0}' does not exist yet; start the service: daemon run")]
    Missing(String),
}

fn refused(action: &'static str, name: &str, cause: &dyn Debug) -> ServiceError {
    let found = format!("{cause:?}");
    let remedy = if found.contains("Type") {
        "the other side has another version of the payload: build both from the same version, and stop every process that still holds the service"
    } else if found.contains("Permission") {
        "the service belongs to another user: run as that user, or choose another --root"
    } else if found.contains("VersionMismatch") {
        "the other side uses another version of iceoryx2: this one needs 0.10.0 exactly"
    } else if found.contains("DoesNotSupport") || found.contains("Incompatible") || found.contains("Exceeds")
    {
        "it exists with other qualities of service: stop every process that still holds it, then start the daemon first"
    } else {
        "stop every process of this domain, then remove its files: rm -r the root path, and the files of the same name in /dev/shm"
    };
    ServiceError::Refused { action, name: name.into(), found, remedy }
}

/// Makes this process known in a domain. Hold the domain's lock.
///
/// # Errors
/// `Refused` with iceoryx2's reason.
pub fn node(domain: &Domain, name: &str) -> Result<Node, ServiceError> {
    // iceoryx2's own log is turned off: its errors are returned, and reported once by the caller.
    set_log_level(LogLevel::Fatal);
    let node_name = NodeName::new(name).map_err(|error| refused("name node", name, &error))?;
    let node = NodeBuilder::new()
        .name(&node_name)
        .config(&domain.config())
        // A handler of iceoryx2's own would end the process without dropping its ports.
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|error| refused("create node", name, &error))?;
    domain.close_segments_to_others()?;
    Ok(node)
}

/// The domain's configuration of iceoryx2 for programs that are not ours, such as the link between machines
/// (docs/across-machines.md). The services that those programs make as mirrors of ours have the qualities that
/// the daemon's services have.
pub fn config_for_others(domain: &Domain) -> Config {
    let mut config = domain.config();
    let topic = &mut config.defaults.publish_subscribe;
    topic.max_subscribers = MAX_READERS;
    topic.max_publishers = MAX_SOURCES;
    topic.max_nodes = MAX_NODES;
    topic.subscriber_max_buffer_size = ESTIMATE_BUFFER;
    topic.publisher_history_size = 1;
    topic.enable_safe_overflow = true;
    config
}

/// Whether a name can be part of service names.
///
/// # Errors
/// `InstanceName` if not.
pub fn check_instance_name(instance: &str) -> Result<(), ServiceError> {
    let allowed = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
    match instance.len() {
        1..=32 if instance.bytes().all(allowed) => Ok(()),
        _ => Err(ServiceError::InstanceName(instance.into())),
    }
}

/// Names and makes or opens the services of one instance.
#[derive(Debug)]
pub struct Services<'a> {
    node: &'a Node,
    instance: &'a str,
}

impl<'a> Services<'a> {
    /// The services of `instance`, through `node`.
    ///
    /// # Errors
    /// `InstanceName` for a name that is no part of a service name.
    pub fn of(node: &'a Node, instance: &'a str) -> Result<Self, ServiceError> {
        check_instance_name(instance)?;
        Ok(Self { node, instance })
    }

    fn name(&self, topic: &str) -> (String, ServiceName) {
        let text = format!("{}/{topic}", self.instance);
        let name = ServiceName::new(&text).expect("checked by Services::of");
        (text, name)
    }

    /// Makes the service on which a payload is published. The daemon's side.
    ///
    /// # Errors
    /// `Refused` where it exists with another type or other qualities.
    pub fn make<T: Published>(&self) -> Result<Topic<T>, ServiceError> {
        let (text, name) = self.name(T::TOPIC);
        self.node
            .service_builder(&name)
            .publish_subscribe::<T>()
            .enable_safe_overflow(true)
            .max_publishers(T::MAX_PUBLISHERS)
            .max_subscribers(MAX_READERS)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(T::BUFFER)
            .history_size(T::HISTORY)
            .open_or_create()
            .map_err(|error| refused("create service", &text, &error))
    }

    /// Opens it: every other process's side.
    ///
    /// # Errors
    /// `Missing` until the daemon has made it, `Refused` where type or qualities do not fit.
    pub fn open<T: Published>(&self) -> Result<Topic<T>, ServiceError> {
        use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError as E;
        let (text, name) = self.name(T::TOPIC);
        match self.node.service_builder(&name).publish_subscribe::<T>().open() {
            Ok(service) => Ok(service),
            Err(E::DoesNotExist | E::IsMarkedForDestruction | E::HangsInCreation) => {
                Err(ServiceError::Missing(text))
            }
            Err(error) => Err(refused("open service", &text, &error)),
        }
    }

    /// Makes the service for commands. The daemon's side.
    ///
    /// # Errors
    /// As [`Services::make`].
    pub fn make_control(&self) -> Result<Control, ServiceError> {
        let (text, name) = self.name("control");
        self.node
            .service_builder(&name)
            .request_response::<Command, Reply>()
            .max_clients(MAX_READERS)
            .max_servers(2)
            .max_nodes(MAX_NODES)
            .max_active_requests_per_client(2)
            .max_response_buffer_size(2)
            .open_or_create()
            .map_err(|error| refused("create service", &text, &error))
    }

    /// Opens it: every other process's side.
    ///
    /// # Errors
    /// As [`Services::open`].
    pub fn open_control(&self) -> Result<Control, ServiceError> {
        use iceoryx2::service::builder::request_response::RequestResponseOpenError as E;
        let (text, name) = self.name("control");
        match self.node.service_builder(&name).request_response::<Command, Reply>().open() {
            Ok(service) => Ok(service),
            Err(E::DoesNotExist | E::IsMarkedForDestruction | E::HangsInCreation) => {
                Err(ServiceError::Missing(text))
            }
            Err(error) => Err(refused("open service", &text, &error)),
        }
    }
}
