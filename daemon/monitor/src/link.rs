//! One instance of the service, followed across its restarts.
//!
//! The same ports receive from a service that was killed and started again, and from one that was stopped and continued
//! (both were tried). Open ports keep an iceoryx2 service in existence, though, so that a daemon of another version could
//! not create its own. The ports are therefore closed soon after the last estimate, and opened again at intervals.
//!
//! On this machine ([`Whence::ThisMachine`]), the age of an estimate follows from its stamp, and an estimate whose stamp is
//! not of this machine's clock is ignored. Messages from another machine ([`Whence::AnotherMachine`]) have stamps of that
//! machine's clock, whose offset is learned from them. The first estimate on new ports may be the last one of a service
//! that died long ago; only a second one shows that the service is alive.

use shared_types::client::Stream;
use shared_types::clock::SenderClock;
use shared_types::{Client, ClientError, Domain, Estimate, Measurement, Status, Truth, logln};
use std::time::Duration;

/// Without an estimate for this long, or for [`SILENT_PERIODS`] of its own, the service is away (ns).
const SILENCE_NS: u64 = 1_000_000_000;
const SILENT_PERIODS: u64 = 5;
/// Between two looks without a screen. The shortest queue in shared memory holds 64 ms at 1 kHz.
pub const LOOK_EVERY: Duration = Duration::from_millis(2);
/// From the end of the estimates to closing the ports (ns): a stopped service may continue within it.
const GRACE_NS: u64 = 2_000_000_000;
/// Between two attempts to reach a service that is away (ns).
const RETRY_NS: u64 = 500_000_000;

/// Where the service runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whence {
    /// Here.
    ThisMachine,
    /// Elsewhere: a link brings its messages into the domain.
    AnotherMachine,
}

/// A message or event that was received.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // passed on one by one, never stored in a collection
pub enum News {
    /// A sample, of a link with measurements.
    Measurement(Measurement),
    /// An estimate, in the order of publication.
    Estimate(Estimate),
    /// What the service did since it started.
    Status(Status),
    /// The true state, where a simulator publishes it.
    Truth(Truth),
    /// The time of the service's machine, if it is another machine.
    Clock(SenderClock),
    /// The service's machine was restarted: earlier messages have stamps of another clock.
    Rebooted,
    /// No estimate arrives.
    Away {
        /// CLOCK_MONOTONIC of the service's machine at the newest estimate, or at the first look (ns).
        since_ns: u64,
        /// What was found, and what to do.
        why: String,
    },
}

/// Logs why no estimate comes, whenever the reason changes, and that estimates come again.
#[derive(Debug, Default)]
pub struct Announcer {
    why_away: Option<String>,
}

impl Announcer {
    /// Logs the changes.
    pub fn note(&mut self, news: &News) {
        match news {
            News::Away { why, .. } if self.why_away.as_ref() != Some(why) => {
                logln!("monitor: no estimate comes, waiting: {why}");
                self.why_away = Some(why.clone());
            }
            News::Estimate(_) if self.why_away.take().is_some() => logln!("monitor: estimates come"),
            _ => {}
        }
    }
}

/// The ports, while they are open.
struct Ports {
    measurements: Option<Stream<Measurement>>,
    estimates: Stream<Estimate>,
    statuses: Stream<Status>,
    truths: Stream<Truth>,
    // Dropped last: the streams belong to it.
    _client: Client,
    opened_ns: u64,
    /// Estimates that these ports have received, and those of them whose stamps are not of this clock.
    n_received: u64,
    n_foreign: u64,
}

/// A reader of one instance. Stays on the thread that makes it.
pub struct Link {
    domain: Domain,
    instance: String,
    whence: Whence,
    clock: SenderClock,
    ports: Option<Ports>,
    /// Publication (of another machine's service: arrival) of the newest estimate, or the first look.
    newest_ns: u64,
    /// Stamp of the newest estimate that was passed on.
    passed_on_ns: u64,
    next_try_ns: u64,
    next_inquiry_ns: u64,
    silence_ns: u64,
    has_measurements: bool,
}

impl Link {
    /// A reader before its first look.
    pub fn new(domain: Domain, instance: &str, whence: Whence, now_ns: u64) -> Self {
        Self {
            domain,
            instance: instance.into(),
            whence,
            clock: SenderClock::default(),
            ports: None,
            newest_ns: now_ns,
            passed_on_ns: 0,
            next_try_ns: now_ns,
            next_inquiry_ns: now_ns,
            silence_ns: SILENCE_NS,
            has_measurements: false,
        }
    }

    /// Also receives the vehicle's measurements.
    pub fn with_measurements(mut self) -> Self {
        self.has_measurements = true;
        self
    }

    /// Passes on what has arrived. At most twice a second, reports that no estimate comes, and why.
    ///
    /// # Errors
    /// `Service` if the existing service cannot be opened: another type, another owner. The next look tries again.
    pub fn look(&mut self, now_ns: u64, news: impl FnMut(News)) -> Result<(), ClientError> {
        let looked = self.open_if_due(now_ns).and_then(|()| self.take(now_ns, news));
        if looked.is_err() {
            self.ports = None;
        }
        looked
    }

    fn take(&mut self, now_ns: u64, mut news: impl FnMut(News)) -> Result<(), ClientError> {
        if let Some(ports) = &mut self.ports {
            if let Some(measurements) = &mut ports.measurements {
                while let Some(measurement) = measurements.take()? {
                    news(News::Measurement(measurement));
                }
            }
            while let Some(status) = ports.statuses.take()? {
                self.silence_ns = SILENCE_NS.max(SILENT_PERIODS * period_ns(&status));
                news(News::Status(status));
            }
            while let Some(truth) = ports.truths.take()? {
                news(News::Truth(truth));
            }
            while let Some(estimate) = ports.estimates.take()? {
                let stamp_ns = estimate.publish_stamp_ns;
                ports.n_received += 1;
                // New ports receive the newest estimate again, even of a service that died long ago.
                let (is_live, at_ns) = match self.whence {
                    Whence::ThisMachine => {
                        let is_of_this_clock =
                            stamp_ns + self.silence_ns >= ports.opened_ns && stamp_ns <= now_ns + SILENCE_NS;
                        ports.n_foreign += u64::from(!is_of_this_clock);
                        (is_of_this_clock, stamp_ns)
                    }
                    Whence::AnotherMachine => {
                        if self.clock.note(stamp_ns, now_ns) {
                            self.passed_on_ns = 0;
                            news(News::Rebooted);
                        }
                        news(News::Clock(self.clock));
                        (ports.n_received > 1, now_ns)
                    }
                };
                if is_live && stamp_ns > self.passed_on_ns {
                    self.passed_on_ns = stamp_ns;
                    self.newest_ns = self.newest_ns.max(at_ns);
                    news(News::Estimate(estimate));
                }
            }
        }
        let silent_ns = now_ns.saturating_sub(self.newest_ns);
        if silent_ns > self.silence_ns && now_ns >= self.next_inquiry_ns {
            self.next_inquiry_ns = now_ns + RETRY_NS;
            news(News::Away { since_ns: self.clock.at(self.newest_ns), why: self.why()? });
        }
        let grace_ns = self.silence_ns + GRACE_NS;
        let opened_ns = self.ports.as_ref().map_or(0, |ports| ports.opened_ns);
        if silent_ns > grace_ns && now_ns.saturating_sub(opened_ns) > grace_ns {
            self.ports = None;
        }
        Ok(())
    }

    fn open_if_due(&mut self, now_ns: u64) -> Result<(), ClientError> {
        if self.ports.is_some() || now_ns < self.next_try_ns {
            return Ok(());
        }
        self.next_try_ns = now_ns + RETRY_NS;
        // Looking for a service must not create the domain.
        if !self.domain.root().exists() {
            return Ok(());
        }
        match self.open(now_ns) {
            Ok(ports) => self.ports = Some(ports),
            Err(ClientError::NoDaemon { .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn open(&self, opened_ns: u64) -> Result<Ports, ClientError> {
        let client = Client::connect(&self.domain, &self.instance, Duration::ZERO)?;
        Ok(Ports {
            measurements: self.has_measurements.then(|| client.measurement_subscriber()).transpose()?,
            statuses: client.status_subscriber()?,
            truths: client.truth_subscriber()?,
            estimates: client.estimate_subscriber()?,
            _client: client,
            opened_ns,
            n_received: 0,
            n_foreign: 0,
        })
    }

    fn why(&self) -> Result<String, ClientError> {
        if self.whence == Whence::AnotherMachine {
            return Ok(format!(
                "none comes over the link: the service of '{}', or one of the two tunnels, does not run, or the network is down",
                self.instance
            ));
        }
        let holder = self.domain.instance_holder(&self.instance)?;
        // One such estimate is the last one of a dead service. More than one means that a process sends them.
        if holder.is_none() && self.ports.as_ref().is_some_and(|ports| ports.n_foreign > 1) {
            return Ok("estimates come whose stamps are not of this machine's clock; if a link brings them from another machine: monitor --remote".into());
        }
        Ok(match holder {
            Some(pid) => {
                format!("process {pid} runs it and publishes nothing: it is stopped, hangs, or starts")
            }
            None => format!(
                "no process runs it; start it: daemon run --instance {} --root {}",
                self.instance,
                self.domain.root().display()
            ),
        })
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.ports = None;
        // The last process to leave a domain removes it.
        let _ = self.domain.remove_if_unused();
    }
}

fn period_ns(status: &Status) -> u64 {
    1_000_000_000_000_u64.checked_div(status.rate_millihertz).unwrap_or(0)
}
