//! The model of what is shown, made from the messages of the service. Time is an argument: nothing here reads a clock.

pub mod history;
pub mod truth;

use crate::link::News;
use crate::model::history::{Histogram, History};
use crate::model::truth::{Comparison, TruthError};
use shared_types::clock::SenderClock;
use shared_types::payload::{Rejection, status_bits};
use shared_types::{Channel, Estimate, Status};
use std::collections::VecDeque;

/// Counts are compared with those of this long ago (ns).
pub const RECENT_NS: u64 = 10_000_000_000;
/// A status bit of a single estimate is shown for this long (ns).
pub const BIT_SHOWN_NS: u64 = 2_000_000_000;

/// The channels of an estimate, in the order of the counters of [`Status`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Position, velocity, force.
    Translation,
    /// Attitude, angular velocity, torque.
    Rotation,
    /// A general linear plant.
    Linear,
}

impl Part {
    /// All, in order.
    pub const ALL: [Self; 3] = [Self::Translation, Self::Rotation, Self::Linear];

    /// The name in configuration and estimate.
    pub fn name(self) -> &'static str {
        ["translation", "rotation", "linear"][self as usize]
    }

    /// What its sensor measures.
    pub fn output(self) -> &'static str {
        ["velocity", "angular velocity", "output"][self as usize]
    }

    /// The unit of its output, its error and its bound; `None` for a linear plant, whose units only its user knows.
    pub fn unit(self) -> Option<&'static str> {
        [Some("m/s"), Some("rad/s"), None][self as usize]
    }

    /// Its report within an estimate.
    pub fn channel(self, estimate: &Estimate) -> &Channel {
        estimate.channels()[self as usize]
    }

    /// The bit that says that it coasts.
    pub fn coasting_bit(self) -> u64 {
        use status_bits::{COASTING_LINEAR, COASTING_ROTATION, COASTING_TRANSLATION};
        [COASTING_TRANSLATION, COASTING_ROTATION, COASTING_LINEAR][self as usize]
    }

    /// The bit that says that it is stale.
    pub fn stale_bit(self) -> u64 {
        use status_bits::{STALE_LINEAR, STALE_ROTATION, STALE_TRANSLATION};
        [STALE_TRANSLATION, STALE_ROTATION, STALE_LINEAR][self as usize]
    }
}

/// Three numbers over time (or, of a linear plant, as many as it has).
#[derive(Debug, Clone)]
pub struct Vector {
    /// What it is, with its unit.
    pub name: &'static str,
    /// Names of its components.
    pub axes: &'static [&'static str],
    /// What is shown, of the newest estimate.
    pub now: Vec<f64>,
    /// 1 σ of each, in the same unit; +∞ where it is unknown.
    pub deviations: [f64; 3],
    /// Each component over time.
    pub histories: Vec<History>,
    /// The least range that a picture of it spans, so that noise looks like noise.
    pub least_span: f64,
    /// Which part of the estimate it belongs to.
    pub part: Part,
    read: fn(&Estimate) -> Vec<f64>,
    read_deviations: fn(&Estimate) -> [f64; 3],
    /// Components up to the last one that was ever other than zero.
    used: usize,
}

impl Vector {
    fn new(
        part: Part,
        name: &'static str,
        axes: &'static [&'static str],
        least_span: f64,
        read: fn(&Estimate) -> Vec<f64>,
        read_deviations: fn(&Estimate) -> [f64; 3],
    ) -> Self {
        Self {
            name,
            axes,
            now: vec![0.0; axes.len()],
            deviations: [f64::INFINITY; 3],
            histories: vec![History::default(); axes.len()],
            least_span,
            part,
            read,
            read_deviations,
            used: 0,
        }
    }

    fn note(&mut self, estimate: &Estimate) {
        self.now = (self.read)(estimate);
        self.deviations = (self.read_deviations)(estimate);
        for (k, (history, &value)) in self.histories.iter_mut().zip(&self.now).enumerate() {
            history.note(estimate.publish_stamp_ns, value);
            if value != 0.0 {
                self.used = self.used.max(k + 1);
            }
        }
    }

    /// Decimals with which its numbers are shown.
    pub fn decimals(&self) -> usize {
        match self.least_span {
            span if span >= 0.1 => 3,
            span if span >= 0.01 => 4,
            _ => 5,
        }
    }

    /// 1 σ of a component; `None` where it is unknown.
    pub fn deviation(&self, component: usize) -> Option<f64> {
        self.deviations.get(component).copied().filter(|deviation| deviation.is_finite())
    }

    /// How many components are shown: of a linear plant, whose size is not published, those up to the last one that was ever other than zero.
    pub fn n_shown(&self) -> usize {
        if self.part == Part::Linear { self.used.max(1) } else { self.axes.len() }
    }
}

static XYZ: [&str; 3] = ["x", "y", "z"];
static RPY: [&str; 3] = ["r", "p", "y"];
static NUMBERS: [&str; 12] = ["1", "2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12"];

fn vectors() -> Vec<Vector> {
    use Part::{Linear, Rotation, Translation};
    let unknown = |_: &Estimate| [f64::INFINITY; 3];
    vec![
        Vector::new(Translation, "position m", &XYZ, 0.5, |e| e.position_m.to_vec(), |e| e.position_std_m),
        Vector::new(
            Translation,
            "velocity m/s",
            &XYZ,
            0.2,
            |e| e.velocity_m_s.to_vec(),
            |e| e.velocity_std_m_s,
        ),
        // Deviations are about the body's axes: near level flight those of roll, pitch and yaw.
        Vector::new(
            Rotation,
            "attitude deg",
            &RPY,
            2.0,
            |e| e.euler_rad.map(f64::to_degrees).to_vec(),
            |e| e.attitude_std_rad.map(f64::to_degrees),
        ),
        Vector::new(
            Rotation,
            "rates deg/s",
            &XYZ,
            2.0,
            |e| e.angular_velocity_rad_s.map(f64::to_degrees).to_vec(),
            |e| e.angular_velocity_std_rad_s.map(f64::to_degrees),
        ),
        Vector::new(
            Translation,
            "learned N",
            &XYZ,
            0.5,
            |e| e.matched_force_n.to_vec(),
            |e| e.matched_force_std_n,
        ),
        Vector::new(
            Rotation,
            "learned N·m",
            &XYZ,
            0.02,
            |e| e.matched_torque_n_m.to_vec(),
            |e| e.matched_torque_std_n_m,
        ),
        Vector::new(Linear, "state", &NUMBERS, 1e-3, |e| e.state.to_vec(), unknown),
        Vector::new(Linear, "learned f", &NUMBERS[..6], 1e-3, |e| e.matched_input.to_vec(), unknown),
    ]
}

/// Where the service is.
#[derive(Debug, Clone, PartialEq)]
pub enum Presence {
    /// No message has arrived yet.
    Unknown,
    /// Estimates arrive.
    Here,
    /// No estimates arrive.
    Away {
        /// CLOCK_MONOTONIC of the service's machine at the newest estimate, or at the first look (ns).
        since_ns: u64,
        /// What was found, and what to do.
        why: String,
    },
}

/// Everything that a view shows.
#[derive(Debug, Clone)]
pub struct Model {
    /// The instance.
    pub instance: String,
    /// The newest estimate of all time.
    pub estimate: Option<Estimate>,
    /// The newest status.
    pub status: Option<Status>,
    /// The clock of all stamps: of this machine, unless the service runs on another one.
    pub clock: SenderClock,
    /// Where the service is.
    pub presence: Presence,
    /// How many restarts of the service were observed.
    pub restarts: u64,
    /// State and learned force over time.
    pub vectors: Vec<Vector>,
    /// ‖ỹ‖ of each channel over time.
    pub output_errors: [History; 3],
    /// σ of each channel over time.
    pub activations: [History; 3],
    /// ‖f̂_N‖ of each channel over time.
    pub native_norms: [History; 3],
    /// Which channels this run of the service has reported.
    configured: [bool; 3],
    /// When each status bit was seen last (ns).
    bits_seen_ns: [u64; 64],
    /// Statuses of the last [`RECENT_NS`], of this run of the service.
    statuses: VecDeque<Status>,
    comparison: Comparison,
    /// Source stamp to publication, of estimates with a new sample, of this run of the service as far as it was heard.
    pub sample_to_output: Histogram,
}

impl Model {
    /// A model before the first message.
    pub fn new(instance: &str) -> Self {
        Self {
            instance: instance.into(),
            estimate: None,
            status: None,
            clock: SenderClock::default(),
            presence: Presence::Unknown,
            restarts: 0,
            vectors: vectors(),
            output_errors: Default::default(),
            activations: Default::default(),
            native_norms: Default::default(),
            configured: [false; 3],
            bits_seen_ns: [0; 64],
            statuses: VecDeque::new(),
            comparison: Comparison::default(),
            sample_to_output: Histogram::default(),
        }
    }

    /// Takes what the link has received.
    pub fn note(&mut self, news: News) {
        match news {
            News::Estimate(estimate) => self.note_estimate(&estimate),
            News::Status(status) => self.note_status(status),
            News::Truth(truth) => self.comparison.note_truth(&truth),
            News::Clock(clock) => self.clock = clock,
            News::Rebooted => *self = Self::new(&std::mem::take(&mut self.instance)),
            News::Measurement(_) => {}
            News::Away { since_ns, why } => self.presence = Presence::Away { since_ns, why },
        }
    }

    fn note_estimate(&mut self, estimate: &Estimate) {
        // A new subscriber receives the newest estimate again, even of a dead service.
        if self.estimate.is_some_and(|newest| newest.publish_stamp_ns >= estimate.publish_stamp_ns) {
            return;
        }
        let at_ns = estimate.publish_stamp_ns;
        let sampled_before_ns = self.estimate.map_or(0, |newest| newest.source_stamp_ns);
        if estimate.source_stamp_ns > sampled_before_ns && sampled_before_ns > 0 {
            self.sample_to_output.note(at_ns.saturating_sub(estimate.source_stamp_ns));
        }
        self.estimate = Some(*estimate);
        self.presence = Presence::Here;
        for (bit, seen_ns) in self.bits_seen_ns.iter_mut().enumerate() {
            if estimate.status & (1 << bit) != 0 {
                *seen_ns = at_ns;
            }
        }
        for (k, part) in Part::ALL.into_iter().enumerate() {
            let channel = part.channel(estimate);
            self.configured[k] |= *channel != Channel::default();
            let coasts = estimate.status & part.coasting_bit() != 0;
            self.output_errors[k].note(at_ns, if coasts { f64::NAN } else { channel.output_error });
            self.activations[k].note(at_ns, channel.activation);
            self.native_norms[k].note(at_ns, channel.native_norm);
        }
        for vector in &mut self.vectors {
            vector.note(estimate);
        }
        self.comparison.note_estimate(estimate);
    }

    fn note_status(&mut self, status: Status) {
        if let Some(before) = &self.status {
            if status.stamp_ns <= before.stamp_ns {
                return;
            }
            if status.start_stamp_ns != before.start_stamp_ns {
                self.restarts += 1;
                self.statuses.clear();
                self.sample_to_output = Histogram::default();
                // It may be that of another vehicle now.
                self.configured = [false; 3];
                self.vectors.iter_mut().for_each(|vector| vector.used = 0);
            }
        }
        while self.statuses.front().is_some_and(|old| status.stamp_ns - old.stamp_ns > RECENT_NS) {
            self.statuses.pop_front();
        }
        self.statuses.push_back(status);
        self.status = Some(status);
    }

    /// The error against the truth, while a simulator publishes it.
    pub fn truth_error(&self) -> Option<TruthError> {
        self.comparison.error(self.estimate?.stamp_ns)
    }

    /// The channels that this service has.
    pub fn parts(&self) -> Vec<Part> {
        Part::ALL.into_iter().filter(|&part| self.configured[part as usize]).collect()
    }

    /// Bits of the newest estimate, and those seen shortly before it.
    pub fn recent_bits(&self) -> u64 {
        let Some(estimate) = &self.estimate else { return 0 };
        let recent =
            |seen_ns: u64| seen_ns > 0 && estimate.publish_stamp_ns.saturating_sub(seen_ns) <= BIT_SHOWN_NS;
        let bits = self.bits_seen_ns.iter().enumerate().filter(|(_, seen_ns)| recent(**seen_ns));
        bits.fold(estimate.status, |bits, (bit, _)| bits | (1 << bit))
    }

    /// How much a count has grown within the last ten seconds, or since the service started.
    pub fn growth(&self, count: impl Fn(&Status) -> u64) -> u64 {
        match (self.statuses.front(), &self.status) {
            (Some(old), Some(new)) => count(new).saturating_sub(count(old)),
            _ => 0,
        }
    }

    /// The same per second; `None` before there are two statuses.
    pub fn growth_per_s(&self, count: impl Fn(&Status) -> u64) -> Option<f64> {
        let (old, new) = (self.statuses.front()?, self.status.as_ref()?);
        let elapsed_ns = new.stamp_ns.checked_sub(old.stamp_ns).filter(|&ns| ns > 0)?;
        Some(self.growth(count) as f64 / (elapsed_ns as f64 / 1e9))
    }

    /// Reasons of rejection with their counts, the most frequent first.
    pub fn rejections(&self) -> Vec<(Rejection, u64)> {
        let Some(status) = &self.status else { return Vec::new() };
        let counts = Rejection::ALL.map(|reason| (reason, status.counters.rejected(reason)));
        let mut counts: Vec<_> = counts.into_iter().filter(|&(_, count)| count > 0).collect();
        counts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        counts
    }

    /// Age of the newest estimate (ns).
    pub fn estimate_age_ns(&self, now_ns: u64) -> Option<u64> {
        Some(now_ns.saturating_sub(self.estimate?.publish_stamp_ns))
    }

    /// Whether an operator has frozen adaptation, by the newest message.
    pub fn is_frozen(&self) -> bool {
        self.estimate.is_some_and(|estimate| estimate.status & status_bits::FROZEN != 0)
    }
}
