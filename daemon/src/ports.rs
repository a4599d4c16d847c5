//! The ports of the service: the only file of the daemon that names iceoryx2's ports.
//!
//! All ports are made under the domain's lock. `take` and `publish` neither allocate nor make a system call. A loan does
//! allocate, so the sample of the next tick is loaned after publication, in the slack.

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use shared_types::payload::{Command, Estimate, Measurement, Reply, Status};
use shared_types::service::{self, Node, ServiceError, Services, Topic};
use shared_types::{Domain, DomainError};
use std::fmt::Debug;
use std::mem::MaybeUninit;

/// Why the ports cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PortsError {
    /// A service or the domain cannot be used.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A port was refused.
    #[error("{action}: {found}; another daemon may hold it: see `daemon control status`")]
    Port {
        /// What was tried.
        action: &'static str,
        /// iceoryx2's reason.
        found: String,
    },
}

impl From<DomainError> for PortsError {
    fn from(error: DomainError) -> Self {
        Self::Service(error.into())
    }
}

fn refused<E: Debug>(action: &'static str) -> impl FnOnce(E) -> PortsError {
    move |error| PortsError::Port { action, found: format!("{error:?}") }
}

type Loan = SampleMutUninit<ipc::Service, MaybeUninit<Estimate>, ()>;

/// The ports of the loop.
pub struct LoopPorts {
    measurement: Subscriber<ipc::Service, Measurement, ()>,
    estimate: Publisher<ipc::Service, Estimate, ()>,
    loan: Option<Loan>,
    _node: Node,
}

impl LoopPorts {
    /// Makes the services `measurement` and, last, `estimate`, whose existence shows clients that the service is
    /// complete.
    ///
    /// # Errors
    /// Which service or port, why, and what helps.
    pub fn make(domain: &Domain, instance: &str) -> Result<Self, PortsError> {
        let _making = domain.lock_for_making()?;
        let node = service::node(domain, "daemon-loop")?;
        let services = Services::of(&node, instance)?;
        let measurement = services.make::<Measurement>()?;
        let measurement =
            measurement.subscriber_builder().create().map_err(refused("subscribe to measurement"))?;
        let estimate = services.make::<Estimate>()?;
        let estimate = estimate.publisher_builder().create().map_err(refused("publish estimate"))?;
        let loan = Some(estimate.loan_uninit().map_err(refused("loan an estimate"))?);
        domain.check_segments()?;
        Ok(Self { measurement, estimate, loan, _node: node })
    }

    /// The oldest measurement not yet taken, and its source. A connection that broke counts as empty.
    pub fn take(&self) -> Option<(Measurement, u128)> {
        let sample = self.measurement.receive().ok().flatten()?;
        Some((*sample, sample.header().publisher_id().value()))
    }

    /// Writes the estimate to its readers.
    pub fn publish(&mut self, estimate: &Estimate) {
        let sent = self.loan.take().is_some_and(|loan| loan.write_payload(*estimate).send().is_ok());
        if !sent {
            // Sending fails if a reader's connection breaks meanwhile. That reader has ended; send again to the others.
            let _ = self.estimate.send_copy(*estimate);
        }
    }

    /// Prepares the next tick: loans the next estimate, which allocates, and maps new sources and readers, so
    /// that the tick itself need not.
    pub fn prepare(&mut self) {
        // A failure concerns one dead source or reader only.
        let _ = self.measurement.update_connections();
        let _ = self.estimate.update_connections();
        if self.loan.is_none() {
            self.loan = self.estimate.loan_uninit().ok();
            if let Some(loan) = &mut self.loan {
                // Writing now brings the cache lines back from the core of the last reader.
                loan.payload_mut().write(Estimate::default());
            }
        }
    }
}

/// The ports of the housekeeping thread.
pub struct HousekeepingPorts {
    status: Publisher<ipc::Service, Status, ()>,
    control: Server<ipc::Service, Command, (), Reply, ()>,
    measurement: Topic<Measurement>,
    _truth: Topic<shared_types::Truth>,
    _node: Node,
}

impl HousekeepingPorts {
    /// Makes the services `status`, `truth` and `control`, and opens `measurement` to see its sources.
    ///
    /// # Errors
    /// Which service or port, why, and what helps.
    pub fn make(domain: &Domain, instance: &str) -> Result<Self, PortsError> {
        let _making = domain.lock_for_making()?;
        let node = service::node(domain, "daemon")?;
        let services = Services::of(&node, instance)?;
        let status = services.make::<Status>()?;
        let status = status.publisher_builder().create().map_err(refused("publish status"))?;
        let control = services.make_control()?;
        let control = control.server_builder().create().map_err(refused("serve control"))?;
        let (measurement, truth) = (services.make::<Measurement>()?, services.make::<shared_types::Truth>()?);
        Ok(Self { status, control, measurement, _truth: truth, _node: node })
    }

    /// Writes the status to its readers.
    pub fn publish(&self, status: &Status) {
        // A failure concerns one dead reader only.
        let _ = self.status.send_copy(*status);
        let _ = self.status.update_connections();
    }

    /// The oldest request not yet answered.
    pub fn request(&self) -> Option<Request> {
        self.control.receive().ok().flatten().map(Request)
    }

    /// Process id of a source, if it is connected.
    pub fn source_pid(&self, source: u128) -> Option<u64> {
        let mut pid = None;
        self.measurement.dynamic_config().list_publishers(|publisher| {
            if publisher.publisher_id.value() == source {
                pid = publisher.node_id.pid::<ipc::Service>().ok().map(|pid| pid.value() as u64);
            }
            CallbackProgression::Continue
        });
        pid
    }
}

/// An operator's request that waits for its answer.
pub struct Request(ActiveRequest<ipc::Service, Command, (), Reply, ()>);

impl Request {
    /// The command: one of [`shared_types::payload::command`].
    pub fn kind(&self) -> u32 {
        self.0.kind
    }

    /// Answers the request.
    pub fn answer(self, reply: Reply) {
        // A client that has ended needs no answer.
        let _ = self.0.send_copy(reply);
    }
}
