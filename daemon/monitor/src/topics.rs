//! The service's messages on Foxglove's channels, for files and live streams alike.
//!
//! | topic | schema | what |
//! |---|---|---|
//! | `/NAME/measurement` | [`Measurement`] | every sample that a source published |
//! | `/NAME/estimate` | [`Estimate`] | every estimate |
//! | `/NAME/truth` | [`Truth`] | the true state, where a simulator publishes it |
//! | `/NAME/status` | [`Status`] | the service's counters, a few times a second |
//! | `/NAME/estimate/odometry`, `/NAME/truth/odometry` | `foxglove.Odometry` | pose and velocities |
//! | `/tf` | `foxglove.FrameTransform` | where the body is, in frame `NAME` |
//! | `/NAME/log` | `foxglove.Log` | changes of the status, restarts, and what is missing |
//!
//! A message's time is its stamp, converted to the wall clock. It is never later than the receipt and never decreases on a
//! topic: a source's clock may be wrong, but a viewer needs increasing times. The stamp itself is a field of the message.

use crate::link::News;
use crate::messages::Recorded;
use crate::motion::{Motion, log_line};
use foxglove::messages::log::Level;
use foxglove::messages::{FrameTransform, Log, Odometry};
use foxglove::{Channel, Context, Encode, PartialMetadata};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Measurement, Status, Truth, status_bits};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The wall clock as CLOCK_MONOTONIC plus a constant that is measured once: setting the clock does not disturb it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WallClock {
    /// Wall clock at CLOCK_MONOTONIC zero (ns since 1970).
    pub at_monotonic_zero_ns: u64,
}

impl WallClock {
    /// Reads both clocks: the closest of three attempts.
    pub fn now() -> Self {
        let look = || {
            let before_ns = monotonic_ns();
            let wall = clock_gettime(ClockId::Realtime);
            let after_ns = monotonic_ns();
            let wall_ns = (wall.tv_sec.max(0) as u64) * 1_000_000_000 + wall.tv_nsec as u64;
            (after_ns - before_ns, wall_ns.saturating_sub(before_ns.midpoint(after_ns)))
        };
        let closest = [look(), look(), look()].into_iter().min().unwrap_or_default();
        Self { at_monotonic_zero_ns: closest.1 }
    }

    /// Wall clock at this instant (ns since 1970).
    pub fn at(&self, stamp_ns: u64) -> u64 {
        self.at_monotonic_zero_ns.saturating_add(stamp_ns)
    }
}

/// Counts of one topic.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// Messages received.
    pub messages: u64,
    /// Gaps in their sequence: what the source left out, and what was overwritten before it was taken.
    pub missing: u64,
    /// Times the sequence began again: a restarted source or service.
    pub restarts: u64,
    #[serde(skip)]
    newest: Option<u64>,
}

impl Tally {
    /// Counts a message; returns how many are missing before it.
    fn count(&mut self, sequence: u64) -> u64 {
        let missing = match self.newest {
            None => 0,
            Some(newest) if sequence > newest => sequence - newest - 1,
            // Repeated or slightly out of order: the source has not restarted, as a sequence begins at 0.
            Some(newest) if newest - sequence < 64 && sequence > 0 => {
                self.messages += 1;
                return 0;
            }
            Some(_) => {
                self.restarts += 1;
                sequence
            }
        };
        self.newest = Some(sequence);
        self.messages += 1;
        self.missing = self.missing.saturating_add(missing);
        missing
    }
}

/// A channel whose times rise.
struct Topic<Message: Encode> {
    channel: Channel<Message>,
    newest_ns: Option<u64>,
}

impl<Message: Encode> Topic<Message> {
    fn new(context: &Arc<Context>, name: &str) -> Self {
        Self { channel: context.channel_builder(name).build(), newest_ns: None }
    }

    /// Logs what happened at `stamp_ns` and was received at `receipt_ns`; `make` is given the time on the wall clock.
    fn log(&mut self, clock: WallClock, stamp_ns: u64, receipt_ns: u64, make: impl FnOnce(u64) -> Message) {
        let mut wall_ns = clock.at(stamp_ns.min(receipt_ns));
        if let Some(newest_ns) = self.newest_ns {
            wall_ns = wall_ns.max(newest_ns + 1);
        }
        self.newest_ns = Some(wall_ns);
        self.channel.log_with_meta(&make(wall_ns), PartialMetadata::with_log_time(wall_ns));
    }
}

/// A change of one of these bits is logged.
const LOGGED: u64 = status_bits::STALE
    | status_bits::STALE_TRANSLATION
    | status_bits::STALE_ROTATION
    | status_bits::STALE_LINEAR
    | status_bits::REACQUIRING
    | status_bits::CATCHING_UP
    | status_bits::ON_GROUND
    | status_bits::WAITING
    | status_bits::COASTING
    | status_bits::FROZEN
    | status_bits::DIVERGED
    | status_bits::PREDICT_ONLY
    | status_bits::INVALID
    | status_bits::STUCK;

/// All channels of one instance.
pub struct Topics {
    clock: WallClock,
    instance: String,
    measurement: Topic<Recorded<Measurement>>,
    estimate: Topic<Recorded<Estimate>>,
    truth: Topic<Recorded<Truth>>,
    status: Topic<Recorded<Status>>,
    estimate_odometry: Topic<Odometry>,
    truth_odometry: Topic<Odometry>,
    transform: Topic<FrameTransform>,
    log: Topic<Log>,
    measurements: Tally,
    estimates: Tally,
    truths: Tally,
    statuses: Tally,
    newest_status_ns: u64,
    logged: Option<u64>,
    is_away: bool,
}

impl Topics {
    /// Channels of `instance` in `context`, without messages.
    pub fn new(context: &Arc<Context>, instance: &str, clock: WallClock) -> Self {
        let name = |topic: &str| format!("/{instance}/{topic}");
        Self {
            clock,
            instance: instance.into(),
            measurement: Topic::new(context, &name("measurement")),
            estimate: Topic::new(context, &name("estimate")),
            truth: Topic::new(context, &name("truth")),
            status: Topic::new(context, &name("status")),
            estimate_odometry: Topic::new(context, &name("estimate/odometry")),
            truth_odometry: Topic::new(context, &name("truth/odometry")),
            transform: Topic::new(context, "/tf"),
            log: Topic::new(context, &name("log")),
            measurements: Tally::default(),
            estimates: Tally::default(),
            truths: Tally::default(),
            statuses: Tally::default(),
            newest_status_ns: 0,
            logged: None,
            is_away: false,
        }
    }

    /// The counts so far, by topic.
    pub fn tallies(&self) -> BTreeMap<String, Tally> {
        let tally = |topic: &str, tally| (format!("/{}/{topic}", self.instance), tally);
        BTreeMap::from([
            tally("measurement", self.measurements),
            tally("estimate", self.estimates),
            tally("truth", self.truths),
            tally("status", self.statuses),
        ])
    }

    /// Logs to the channels what was received at `receipt_ns`.
    pub fn note(&mut self, news: &News, receipt_ns: u64) {
        match news {
            News::Measurement(sample) => {
                let missing = self.measurements.count(sample.sequence);
                self.log_missing(missing, "measurement", receipt_ns);
                self.measurement.log(self.clock, sample.stamp_ns, receipt_ns, |_| Recorded(*sample));
            }
            News::Estimate(estimate) => self.note_estimate(estimate, receipt_ns),
            News::Truth(truth) => {
                let missing = self.truths.count(truth.sequence);
                self.log_missing(missing, "truth", receipt_ns);
                self.truth.log(self.clock, truth.stamp_ns, receipt_ns, |_| Recorded(*truth));
                let (frame, motion) = (&self.instance, Motion::of(truth));
                let body = format!("{frame}/true_body");
                self.truth_odometry.log(self.clock, truth.stamp_ns, receipt_ns, |wall_ns| {
                    motion.odometry(wall_ns, frame, &body)
                });
                self.transform.log(self.clock, truth.stamp_ns, receipt_ns, |wall_ns| {
                    motion.frame_transform(wall_ns, frame, &body)
                });
            }
            // New ports receive the newest status again.
            News::Status(status) if status.stamp_ns <= self.newest_status_ns => {}
            News::Status(status) => {
                self.newest_status_ns = status.stamp_ns;
                let missing = self.statuses.count(status.sequence);
                self.log_missing(missing, "status", receipt_ns);
                self.status.log(self.clock, status.stamp_ns, receipt_ns, |_| Recorded(*status));
            }
            News::Away { why, .. } if !self.is_away => {
                (self.is_away, self.logged) = (true, None);
                self.log_text(Level::Error, format!("no estimate comes: {why}"), receipt_ns);
            }
            // `Clock` and `Rebooted` come from other machines only.
            News::Away { .. } | News::Clock(_) | News::Rebooted => {}
        }
    }

    fn note_estimate(&mut self, estimate: &Estimate, receipt_ns: u64) {
        let restarts = self.estimates.restarts;
        let missing = self.estimates.count(estimate.sequence);
        if self.estimates.restarts > restarts {
            self.log_text(Level::Warning, "the service has started again".into(), receipt_ns);
        }
        self.log_missing(missing, "estimate", receipt_ns);
        let logged = estimate.status & LOGGED;
        if self.logged != Some(logged) {
            let level = match logged {
                0 => Level::Info,
                _ if logged & (status_bits::STALE | status_bits::INVALID) != 0 => Level::Error,
                _ => Level::Warning,
            };
            self.log_text(level, status_bits::words(estimate.status).join(", "), receipt_ns);
        }
        (self.logged, self.is_away) = (Some(logged), false);
        // The time of publication: several estimates may have the state of one instant.
        let stamp_ns = estimate.publish_stamp_ns;
        self.estimate.log(self.clock, stamp_ns, receipt_ns, |_| Recorded(*estimate));
        if let Some(motion) = Motion::estimated(estimate) {
            let frame = &self.instance;
            let body = format!("{frame}/body");
            self.estimate_odometry
                .log(self.clock, stamp_ns, receipt_ns, |wall_ns| motion.odometry(wall_ns, frame, &body));
            self.transform.log(self.clock, stamp_ns, receipt_ns, |wall_ns| {
                motion.frame_transform(wall_ns, frame, &body)
            });
        }
    }

    fn log_missing(&mut self, missing: u64, topic: &str, receipt_ns: u64) {
        if missing > 0 {
            self.log_text(
                Level::Warning,
                format!("{missing} missing on /{}/{topic}", self.instance),
                receipt_ns,
            );
        }
    }

    fn log_text(&mut self, level: Level, message: String, receipt_ns: u64) {
        let name = &self.instance;
        self.log.log(self.clock, receipt_ns, receipt_ns, |wall_ns| log_line(wall_ns, level, name, message));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_restarts_are_counted_and_repetitions_are_not() {
        let mut tally = Tally::default();
        let missing: Vec<u64> = [7, 8, 11, 11, 10, 12, 500, 2, 3, 0, 1]
            .into_iter()
            .map(|sequence| tally.count(sequence))
            .collect();
        assert_eq!(missing, [0, 0, 2, 0, 0, 0, 487, 2, 0, 0, 0]);
        assert_eq!((tally.messages, tally.missing, tally.restarts), (11, 491, 2));
    }

    #[test]
    fn the_wall_clock_is_that_of_the_system() {
        let clock = WallClock::now();
        let system = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
        // A second is far more than passes between the two looks.
        assert!(clock.at(monotonic_ns()).abs_diff(system.as_nanos() as u64) < 1_000_000_000);
    }
}
