//! Joins quantities of one instant into a sample.
//!
//! LOCAL_POSITION_NED and ATTITUDE(_QUATERNION) have times of their own. Two messages whose times differ by no more than the
//! configured tolerance become one sample, at the newer time. A message waits for its counterpart no longer than the
//! tolerance, and not at all if the vehicle sends no counterpart. ODOMETRY needs none.

use crate::clock::{Observed, VehicleClock};
use crate::convert::{self, Motion};
use crate::settings::Settings;
use crate::tally::Tally;
use shared_types::Measurement;
use shared_types::payload::valid;

/// A message that has not arrived for this long counts as not sent, and an older set-point is not used (ns).
pub(crate) const RECENT_NS: u64 = 1_000_000_000;

/// Whether it has arrived recently.
pub(crate) fn is_recent(at_ns: Option<u64>, now_ns: u64) -> bool {
    at_ns.is_some_and(|at_ns| now_ns.saturating_sub(at_ns) < RECENT_NS)
}

/// The quantities of motion in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Half {
    Whole,
    Position,
    Attitude,
}

/// The two clocks of MAVLink's messages, which need not be the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimeBase {
    Microseconds,
    Milliseconds,
}

#[derive(Debug, Clone, Copy)]
struct Pending {
    sample: Measurement,
    base: TimeBase,
    oldest_ns: i128,
    newest_ns: i128,
    receive_ns: u64,
    has_position: bool,
    has_attitude: bool,
}

/// Makes samples.
#[derive(Debug)]
pub(crate) struct Joiner {
    settings: Settings,
    microseconds: VehicleClock,
    milliseconds: VehicleClock,
    newest_stamp_ns: u64,
    pending: Option<Pending>,
    /// When the first message arrived; until a second later it is not known which others will.
    began_ns: Option<u64>,
    /// When each of the two messages last arrived.
    position_at_ns: Option<u64>,
    attitude_at_ns: Option<u64>,
    attitude: Option<([f64; 4], u64)>,
    thrust: Option<(f64, u64)>,
    torque: Option<([f64; 3], u64)>,
    /// Samples that were not fetched yet, oldest first.
    pub(crate) samples: Vec<Measurement>,
}

impl Joiner {
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            settings,
            microseconds: VehicleClock::default(),
            milliseconds: VehicleClock::default(),
            newest_stamp_ns: 0,
            pending: None,
            began_ns: None,
            position_at_ns: None,
            attitude_at_ns: None,
            attitude: None,
            thrust: None,
            torque: None,
            samples: Vec::new(),
        }
    }

    /// The clock of ODOMETRY, or of the halves.
    pub(crate) fn clock(&self, is_odometry: bool) -> &VehicleClock {
        if is_odometry { &self.microseconds } else { &self.milliseconds }
    }

    /// An answer to TIMESYNC, for both clocks.
    pub(crate) fn exchange(&mut self, sent_ns: u64, vehicle_ns: i128, received_ns: u64) {
        for clock in [&mut self.microseconds, &mut self.milliseconds] {
            clock.exchange(sent_ns, vehicle_ns, received_ns);
        }
    }

    /// Whether a message waits for its counterpart.
    pub(crate) fn waits(&self) -> bool {
        self.pending.is_some()
    }

    /// Completes a sample whose counterpart does not arrive.
    pub(crate) fn poll(&mut self, now_ns: u64, tally: &mut Tally) {
        let join_ns = self.settings.join_ns;
        if self.pending.is_some_and(|pending| now_ns.saturating_sub(pending.receive_ns) >= join_ns) {
            self.complete(tally);
        }
    }

    /// Set-points that are used while they are fresh.
    pub(crate) fn take_setpoints(&mut self, thrust: Option<f64>, torque: Option<[f64; 3]>, receive_ns: u64) {
        self.thrust = thrust.map(|thrust| (thrust, receive_ns)).or(self.thrust);
        self.torque = torque.map(|torque| (torque, receive_ns)).or(self.torque);
    }

    /// Takes ODOMETRY of this time.
    pub(crate) fn take_whole(
        &mut self,
        time_us: u64,
        receive_ns: u64,
        motion: Motion,
        tally: &mut Tally,
    ) -> Observed {
        let vehicle_ns = i128::from(time_us) * 1000;
        self.join(Half::Whole, TimeBase::Microseconds, vehicle_ns, receive_ns, motion, tally)
    }

    /// Takes a half of this time.
    pub(crate) fn take_half(
        &mut self,
        half: Half,
        time_boot_ms: u32,
        receive_ns: u64,
        motion: Motion,
        tally: &mut Tally,
    ) -> Observed {
        match half {
            Half::Position => self.position_at_ns = Some(receive_ns),
            _ => self.attitude_at_ns = Some(receive_ns),
        }
        let vehicle_ns = i128::from(time_boot_ms) * 1_000_000;
        self.join(half, TimeBase::Milliseconds, vehicle_ns, receive_ns, motion, tally)
    }

    fn clock_of(&mut self, base: TimeBase) -> &mut VehicleClock {
        match base {
            TimeBase::Microseconds => &mut self.microseconds,
            TimeBase::Milliseconds => &mut self.milliseconds,
        }
    }

    /// Adds a message to the half that waits, or begins a sample with it.
    fn join(
        &mut self,
        half: Half,
        base: TimeBase,
        vehicle_ns: i128,
        receive_ns: u64,
        motion: Motion,
        tally: &mut Tally,
    ) -> Observed {
        if motion == Motion::default() {
            tally.empty += 1;
            return Observed::Steady;
        }
        let tolerance_ns = i128::from(self.settings.join_ns);
        let fits = |pending: &Pending| {
            let span_ns = pending.newest_ns.max(vehicle_ns) - pending.oldest_ns.min(vehicle_ns);
            let is_free = match half {
                Half::Whole => false,
                Half::Position => !pending.has_position,
                Half::Attitude => !pending.has_attitude,
            };
            is_free && pending.base == base && span_ns <= tolerance_ns
        };
        if !self.pending.as_ref().is_some_and(fits) {
            self.complete(tally);
        }
        let observed = self.clock_of(base).observe(vehicle_ns, receive_ns);
        if observed == Observed::Reset {
            self.pending = None;
            tally.clock_resets += 1;
        }
        let pending = self.pending.get_or_insert(Pending {
            sample: Measurement::default(),
            base,
            oldest_ns: vehicle_ns,
            newest_ns: vehicle_ns,
            receive_ns,
            has_position: false,
            has_attitude: false,
        });
        pending.sample = motion.add_to(pending.sample);
        pending.oldest_ns = pending.oldest_ns.min(vehicle_ns);
        pending.newest_ns = pending.newest_ns.max(vehicle_ns);
        pending.has_position |= half != Half::Attitude;
        pending.has_attitude |= half != Half::Position;
        let (has_position, has_attitude) = (pending.has_position, pending.has_attitude);
        if let Some(attitude_wxyz) = motion.attitude_wxyz {
            self.attitude = Some((attitude_wxyz, receive_ns));
        }
        let is_new = is_recent(Some(*self.began_ns.get_or_insert(receive_ns)), receive_ns);
        let may_come = |at_ns| is_new || is_recent(at_ns, receive_ns);
        let is_complete = (has_position || !may_come(self.position_at_ns))
            && (has_attitude || !may_come(self.attitude_at_ns));
        if is_complete {
            self.complete(tally);
        }
        observed
    }

    /// Makes the sample that waits, if one does.
    fn complete(&mut self, tally: &mut Tally) {
        let Some(Pending { mut sample, base, newest_ns, receive_ns, .. }) = self.pending.take() else {
            return;
        };
        let stamp_ns = self.clock_of(base).stamp_ns(newest_ns);
        let Some(stamp_ns) = stamp_ns.filter(|stamp_ns| *stamp_ns > self.newest_stamp_ns) else {
            tally.out_of_order += 1;
            return;
        };
        self.newest_stamp_ns = stamp_ns;
        let is_fresh = |at_ns: u64| is_recent(Some(at_ns), receive_ns);
        let thrust = self.thrust.filter(|(_, at_ns)| is_fresh(*at_ns));
        let attitude = self.attitude.filter(|(_, at_ns)| is_fresh(*at_ns));
        if let (Some(thrust_n), Some((thrust, _)), Some((wxyz, _))) =
            (self.settings.thrust_n, thrust, attitude)
        {
            sample = sample.with_force_n(convert::force_n(thrust, thrust_n, wxyz));
        }
        let torque = self.torque.filter(|(_, at_ns)| is_fresh(*at_ns));
        if let (Some(full_n_m), Some((torque, _))) = (self.settings.torque_n_m, torque) {
            sample = sample.with_torque_n_m(std::array::from_fn(|axis| torque[axis] * full_n_m[axis]));
        }
        (sample.stamp_ns, sample.sequence) = (stamp_ns, tally.samples);
        tally.samples += 1;
        tally.samples_with_force += u64::from(sample.has(valid::FORCE));
        self.samples.push(sample);
    }
}
