//! The input gate decides which samples are accepted. A rejected sample is counted by its reason and changes no state.
//!
//! Depends on the configuration of the input, the payload's table and the observer's sample; reads no clock.

use crate::config::{InputConfig, SourcePolicy};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use observer::{LinearOutput, Quality, Sample, Velocity};
use serde::{Deserialize, Serialize};
use shared_types::Measurement;
use shared_types::payload::{
    MAX_SEQUENCE_GAP, QUATERNION_NORM_TOLERANCE, Rejection, absent, flags, frame, valid,
};
use shared_types::service::MAX_SOURCES;
use shared_types::table::{Bound, Limit, Message, Payload, Value};

/// If samples are the clock, a stamp further ahead than this starts a new time, if its source may do so (s).
const MAX_JUMP_S: f64 = 60.0;
/// How many replaced sources are remembered. They cannot take the stream back while another source is alive.
const MAX_REPLACED: usize = 8;

/// A sample to be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accepted {
    /// For the observer of the rigid body.
    pub sample: Sample,
    /// For the observer of a general linear plant.
    pub linear: LinearSample,
    /// Size of the gap in the source's sequence before it: samples that have not arrived.
    pub lost: u64,
    /// Whether it was counted as lost: it arrives after a later one of its source.
    pub found: bool,
    /// Whether it is the first one of its source, or the source started again.
    pub new_source: bool,
    /// Whether its stamp does not continue from the ones before, so that the state must start again. Only if samples are
    /// the clock.
    pub new_time: bool,
    /// Whether velocity, angular velocity, output repeat the value before to the bit, or are nothing but zeros.
    pub repeats: [bool; 3],
    /// Likewise for longer than a working sensor does.
    pub stuck: [bool; 3],
    /// Whether the vehicle says that it stands on the ground; `None` where the source has never said so.
    pub on_ground: Option<bool>,
}

/// How a sample arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrival {
    /// When it was taken from the queue (ns).
    pub now_ns: u64,
    /// An older one is too late (ns).
    pub window_start_ns: u64,
    /// Whether its source has told a field of this instant already.
    pub is_repeated: bool,
}

/// What was measured of a general linear plant and commanded to it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LinearSample {
    /// y.
    pub output: Option<LinearOutput>,
    /// u.
    pub input: Option<LinearOutput>,
}

/// The newest of all accepted samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Newest {
    source: u128,
    sequence: u64,
    stamp_ns: u64,
    /// When any sample was taken from the queue last (ns).
    arrival_ns: u64,
}

/// A source and its newest accepted sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Source {
    source: u128,
    /// Where its sequence began.
    first_sequence: u64,
    sequence: u64,
    stamp_ns: u64,
    /// When it was taken from the queue.
    arrival_ns: u64,
    /// The newest sequence that arrived, accepted or not.
    seen_sequence: u64,
    /// Gaps before samples that were rejected.
    lost_before_seen: u64,
    /// Whether it ever said that the vehicle stands on the ground.
    tells_ground: bool,
    /// Of velocity, angular velocity, output.
    repeats: [Repeats; 3],
}

/// Accepts samples in the order of each source's sequence, within physical limits: of all sources, or of one at a time.
///
/// No bad sample closes the gate for ever: after `takeover_after_s` without an accepted sample, the next good one is accepted
/// as a new beginning.
#[derive(Debug, Clone)]
pub struct Gate {
    limits: InputConfig,
    /// Whether stamps are compared with the clock.
    check_clock: bool,
    seen: GateState,
}

/// The state of a gate: everything that its next decision depends on, except the sample and the limits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct GateState {
    newest: Option<Newest>,
    /// Those in use. Of one at a time, the first.
    sources: [Option<Source>; MAX_SOURCES],
    other_source: Option<u128>,
    replaced: [Option<u128>; MAX_REPLACED],
}

impl GateState {
    fn of(&self, source: u128) -> Option<&Source> {
        self.sources.iter().flatten().find(|own| own.source == source)
    }

    fn of_mut(&mut self, source: u128) -> Option<&mut Source> {
        self.sources.iter_mut().flatten().find(|own| own.source == source)
    }
}

/// How often a sensor repeats one value.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Repeats {
    value: [f64; 6],
    count: u64,
}

impl Repeats {
    /// How many times in a row this value has been repeated.
    fn after(&self, value: &[f64]) -> Self {
        let mut padded = [0.0; 6];
        padded[..value.len()].copy_from_slice(value);
        let is_same = padded.map(f64::to_bits) == self.value.map(f64::to_bits);
        Self { value: padded, count: if is_same { self.count.saturating_add(1) } else { 0 } }
    }
}

impl Gate {
    /// A gate before the first sample. `check_clock` is false if samples are the clock.
    pub fn new(limits: InputConfig, check_clock: bool) -> Self {
        Self { limits, check_clock, seen: GateState::default() }
    }

    /// Its state.
    pub fn state(&self) -> GateState {
        self.seen
    }

    /// Continues from the state of another gate.
    pub fn resume(&mut self, seen: &GateState) {
        self.seen = *seen;
    }

    /// Checks a sample of `source`.
    ///
    /// # Errors
    /// The reason for which the sample is rejected.
    pub fn judge(
        &mut self,
        measurement: &Measurement,
        source: u128,
        arrival: &Arrival,
    ) -> Result<Accepted, Rejection> {
        match self.check(measurement, source, arrival) {
            Ok(accepted) => Ok(self.take(measurement, source, arrival.now_ns, accepted)),
            Err(reason) => {
                self.see(measurement, source);
                Err(reason)
            }
        }
    }

    fn take(
        &mut self,
        measurement: &Measurement,
        source: u128,
        now_ns: u64,
        mut accepted: Accepted,
    ) -> Accepted {
        let Measurement { sequence, stamp_ns, .. } = *measurement;
        if let Some(before) = self.source().filter(|&before| before != source && self.is_exclusive()) {
            self.seen.replaced.rotate_right(1);
            self.seen.replaced[0] = Some(before);
            self.seen.other_source = Some(before);
            self.seen.sources = [None; MAX_SOURCES];
        }
        if accepted.new_time {
            (self.seen.sources, self.seen.newest) = ([None; MAX_SOURCES], None);
        }
        let before = self.seen.of(source).copied();
        let place = self.place_of(source).or_else(|| self.free_place(now_ns)).unwrap_or(0);
        let continued = before.filter(|_| !accepted.new_source);
        let mut own = Source {
            source,
            first_sequence: continued.map_or(sequence, |before| before.first_sequence.min(sequence)),
            sequence: continued.map_or(sequence, |before| before.sequence.max(sequence)),
            stamp_ns: continued.map_or(stamp_ns, |before| before.stamp_ns.max(stamp_ns)),
            arrival_ns: now_ns,
            seen_sequence: continued.map_or(sequence, |before| before.seen_sequence.max(sequence)),
            lost_before_seen: 0,
            tells_ground: measurement.is_on_ground() || before.is_some_and(|before| before.tells_ground),
            repeats: before.map(|before| before.repeats).unwrap_or_default(),
        };
        accepted.repeats = own.repeats(measurement);
        let after = self.limits.stuck_after_samples;
        let is_stuck =
            |place: usize| accepted.repeats[place] && after > 0 && own.repeats[place].count >= after;
        accepted.stuck = std::array::from_fn(is_stuck);
        accepted.on_ground = own.tells_ground.then(|| measurement.is_on_ground());
        self.seen.sources[place] = Some(own);
        let newest = self.seen.newest.filter(|newest| newest.stamp_ns > stamp_ns);
        self.seen.newest = Some(Newest {
            arrival_ns: now_ns,
            ..newest.unwrap_or(Newest { source, sequence, stamp_ns, arrival_ns: now_ns })
        });
        accepted
    }

    /// Notes a sample that arrived at `now_ns` and is not used because the loop is late. It does not count as lost, and
    /// its source counts as alive.
    pub fn turn_away(&mut self, measurement: &Measurement, source: u128, now_ns: u64) {
        if let Some(own) = self.seen.of_mut(source) {
            own.arrival_ns = now_ns;
            self.seen.newest.iter_mut().for_each(|newest| newest.arrival_ns = now_ns);
        }
        self.see(measurement, source);
    }

    fn see(&mut self, measurement: &Measurement, source: u128) {
        let sequence = measurement.sequence;
        let has_begun = self.seen.newest.is_some();
        match self.seen.of_mut(source) {
            Some(own) if (1..=MAX_SEQUENCE_GAP).contains(&sequence.saturating_sub(own.seen_sequence)) => {
                own.lost_before_seen += sequence - own.seen_sequence - 1;
                own.seen_sequence = sequence;
            }
            None if has_begun => self.seen.other_source = Some(source),
            _ => {}
        }
    }

    fn is_exclusive(&self) -> bool {
        self.limits.source != SourcePolicy::All
    }

    fn place_of(&self, source: u128) -> Option<usize> {
        self.seen.sources.iter().position(|own| own.is_some_and(|own| own.source == source))
    }

    /// Where a new source may stand: a place that is free, else that of the one that is silent for longest.
    fn free_place(&self, now_ns: u64) -> Option<usize> {
        let places = self.seen.sources.iter().enumerate();
        let silent = |own: &Source| self.is_silent(own.arrival_ns, now_ns);
        let usable = places.filter(|(_, own)| own.as_ref().is_none_or(silent));
        usable.min_by_key(|(_, own)| own.map(|own| own.arrival_ns)).map(|(place, _)| place)
    }

    fn is_silent(&self, arrival_ns: u64, now_ns: u64) -> bool {
        now_ns.saturating_sub(arrival_ns) >= nanoseconds(self.limits.takeover_after_s)
    }

    /// How a sample arrives at `now_ns` where nothing late is taken: samples of one source in their order.
    pub fn in_order(&self, measurement: &Measurement, now_ns: u64) -> Arrival {
        let window_start_ns = self.newest_stamp_ns().unwrap_or(0);
        Arrival { now_ns, window_start_ns, is_repeated: measurement.stamp_ns == window_start_ns }
    }

    /// Forgets everything: the next sample is the first.
    pub fn forget(&mut self) {
        self.seen = GateState::default();
    }

    /// The source of the newest sample.
    pub fn source(&self) -> Option<u128> {
        self.seen.newest.map(|newest| newest.source)
    }

    /// Another source whose samples were refused.
    pub fn other_source(&self) -> Option<u128> {
        self.seen.other_source
    }

    /// The newest stamp of the accepted samples (ns).
    pub fn newest_stamp_ns(&self) -> Option<u64> {
        self.seen.newest.map(|newest| newest.stamp_ns)
    }

    /// Sequence of the sample with the newest stamp.
    pub fn newest_sequence(&self) -> Option<u64> {
        self.seen.newest.map(|newest| newest.sequence)
    }

    fn check(&self, m: &Measurement, source: u128, arrival: &Arrival) -> Result<Accepted, Rejection> {
        let Arrival { now_ns, window_start_ns, is_repeated } = *arrival;
        let sample = sample_of(m, &self.limits)?;
        let linear = linear_sample_of(m);
        let anew = Accepted {
            sample,
            linear,
            lost: 0,
            found: false,
            new_source: true,
            new_time: false,
            repeats: [false; 3],
            stuck: [false; 3],
            on_ground: None,
        };
        if self.check_clock {
            if m.stamp_ns > now_ns.saturating_add(nanoseconds(self.limits.max_future_s)) {
                return Err(Rejection::FarFuture);
            }
            if m.stamp_ns.saturating_add(nanoseconds(self.limits.max_age_s)) < now_ns {
                return Err(Rejection::TooOld);
            }
        } else if m.stamp_ns > u64::MAX / 4 {
            // A stamp of more than a century cannot be right, and arithmetic with it would overflow.
            return Err(Rejection::FarFuture);
        }
        let Some(newest) = &self.seen.newest else { return Ok(anew) };

        let all_silent = self.is_silent(newest.arrival_ns, now_ns);
        let own = self.seen.of(source);
        let may_appear = match self.limits.source {
            SourcePolicy::All => self.free_place(now_ns).is_some(),
            SourcePolicy::First => false,
            SourcePolicy::Newest => !self.seen.replaced.contains(&Some(source)),
        };
        if own.is_none() && !all_silent && !may_appear {
            return Err(Rejection::OtherSource);
        }
        if is_repeated {
            return Err(Rejection::RepeatedStamp);
        }
        let jumps = !self.check_clock && m.stamp_ns > newest.stamp_ns.saturating_add(nanoseconds(MAX_JUMP_S));
        if m.stamp_ns < window_start_ns || jumps {
            return match !self.check_clock && (own.is_none() || all_silent) {
                true => Ok(Accepted { new_time: true, ..anew }),
                false if jumps => Err(Rejection::FarFuture),
                false => Err(Rejection::TooLate),
            };
        }
        let Some(own) = own else { return Ok(anew) };
        if (1..=MAX_SEQUENCE_GAP).contains(&m.sequence.saturating_sub(own.sequence)) {
            let gap = m.sequence.saturating_sub(own.seen_sequence).saturating_sub(1);
            return Ok(Accepted { lost: own.lost_before_seen + gap, new_source: false, ..anew });
        }
        if m.sequence < own.sequence && m.stamp_ns < own.stamp_ns {
            return Ok(Accepted { found: m.sequence > own.first_sequence, new_source: false, ..anew });
        }
        match self.is_silent(own.arrival_ns, now_ns) || (m.sequence == 0 && own.sequence > 0) {
            true => Ok(anew),
            false => Err(Rejection::SequenceBackwards),
        }
    }
}

impl Source {
    /// Which readings are what this source said before, or nothing but zeros, which no sensor of a moving vehicle says twice by
    /// chance and one without a signal begins with.
    fn repeats(&mut self, m: &Measurement) -> [bool; 3] {
        let fields: [(u32, &[f64]); 3] = [
            (valid::VELOCITY, &m.velocity_m_s),
            (valid::ANGULAR_VELOCITY, &m.angular_velocity_rad_s),
            (valid::OUTPUT, &m.output),
        ];
        std::array::from_fn(|place| {
            let ((field, value), repeats) = (fields[place], &mut self.repeats[place]);
            if m.has(field) {
                *repeats = repeats.after(value);
            }
            m.has(field) && (repeats.count > 0 || value.iter().all(|number| *number == 0.0))
        })
    }
}

/// Checks each valid field against its row in the table of [`Measurement`].
///
/// # Errors
/// `Malformed`, `NotFinite`, `BeyondLimits` or `QuaternionNorm`.
fn check_values(m: &Measurement, limits: &InputConfig) -> Result<(), Rejection> {
    let frames = [(valid::VELOCITY, m.velocity_frame), (valid::FORCE, m.force_frame)];
    let has_unknown_frame =
        frames.iter().any(|(bit, frame)| m.has(*bit) && ![frame::INERTIAL, frame::BODY].contains(frame));
    let has_unknown_bit =
        m.valid & !valid::ALL != 0 || m.flags & !flags::ALL != 0 || m.absent & !absent::ALL != 0;
    let is_partial = m.has(valid::SPECIFIC_FORCE) && missing(m, absent::SPECIFIC_FORCE_X).contains(&true);
    if m.valid & valid::ALL == 0 || has_unknown_bit || has_unknown_frame || is_partial {
        return Err(Rejection::Malformed);
    }
    if !m.is_finite() {
        return Err(Rejection::NotFinite);
    }
    let fields = Measurement::TABLE.fields.iter().enumerate();
    for (i, field) in fields.filter(|(_, field)| m.has(field.valid)) {
        let Value::Numbers(numbers) = m.value(i) else { continue };
        let norm = || numbers.iter().map(|x| x * x).sum::<f64>().sqrt();
        match field.limit {
            Limit::Norm(bound) if norm() > value_of(bound, limits) => return Err(Rejection::BeyondLimits),
            Limit::Each(bound) if numbers.iter().any(|x| x.abs() > value_of(bound, limits)) => {
                return Err(Rejection::BeyondLimits);
            }
            Limit::UnitNorm if (norm() - 1.0).abs() > QUATERNION_NORM_TOLERANCE => {
                return Err(Rejection::QuaternionNorm);
            }
            Limit::NotNegative if numbers.iter().any(|x| *x < 0.0) => return Err(Rejection::BeyondLimits),
            _ => {}
        }
    }
    Ok(())
}

/// Which of three components are absent, of which this is the bit of the first.
pub(crate) fn missing(m: &Measurement, first: u32) -> [bool; 3] {
    std::array::from_fn(|axis| m.absent & (first << axis) != 0)
}

/// The configured value of a bound.
fn value_of(bound: Bound, limits: &InputConfig) -> f64 {
    match bound {
        Bound::Speed => limits.max_speed_m_s,
        Bound::AngularRate => limits.max_angular_rate_rad_s,
        Bound::SpecificForce => limits.max_specific_force_m_s2,
        Bound::Position => limits.max_position_m,
        Bound::Force => limits.max_force_n,
        Bound::Torque => limits.max_torque_n_m,
        Bound::Output => limits.max_output,
        Bound::Input => limits.max_input,
    }
}

/// A measurement as a sample for the observer of the rigid body.
///
/// # Errors
/// If a value cannot be used: `Malformed`, `NotFinite`, `BeyondLimits` or `QuaternionNorm`.
pub fn sample_of(m: &Measurement, limits: &InputConfig) -> Result<Sample, Rejection> {
    check_values(m, limits)?;
    let vector = |bit: u32, value: [f64; 3]| m.has(bit).then(|| Vector3::from(value));
    let attitude = || {
        let [w, x, y, z] = m.attitude_wxyz;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    };
    Ok(Sample {
        stamp_ns: m.stamp_ns,
        velocity: vector(valid::VELOCITY, m.velocity_m_s).map(|velocity| match m.velocity_frame {
            frame::BODY => Velocity::Body(velocity),
            _ => Velocity::Inertial(velocity),
        }),
        angular_velocity_rad_s: vector(valid::ANGULAR_VELOCITY, m.angular_velocity_rad_s),
        position_m: vector(valid::POSITION, m.position_m),
        attitude: m.has(valid::ATTITUDE).then(attitude),
        specific_force_m_s2: vector(valid::SPECIFIC_FORCE, m.specific_force_m_s2),
        force_n: vector(valid::FORCE, m.force_n),
        force_is_body: m.force_frame == frame::BODY,
        torque_n_m: vector(valid::TORQUE, m.torque_n_m),
        velocity_quality: quality(m, absent::VELOCITY_X, m.velocity_std_m_s),
        angular_velocity_quality: quality(m, absent::ANGULAR_VELOCITY_X, m.angular_velocity_std_rad_s),
        position_quality: quality(m, absent::POSITION_X, m.position_std_m),
        attitude_std_rad: m.attitude_std_rad,
        specific_force_std_m_s2: m.specific_force_std_m_s2,
        ..Sample::default()
    })
}

fn quality(m: &Measurement, first: u32, std: [f64; 3]) -> Quality {
    Quality { std, missing: missing(m, first), repeats: false }
}

/// A measurement whose values are checked, as a sample for the observer of a general linear plant.
fn linear_sample_of(m: &Measurement) -> LinearSample {
    let vector = |bit: u32, value: [f64; 6]| m.has(bit).then(|| LinearOutput::from(value));
    LinearSample { output: vector(valid::OUTPUT, m.output), input: vector(valid::INPUT, m.input) }
}

fn nanoseconds(duration_s: f64) -> u64 {
    (duration_s * 1e9) as u64
}

#[cfg(test)]
mod tests;
