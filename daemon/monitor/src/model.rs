//! What is shown, from what the service publishes. Time is an argument: nothing here reads a clock.

use crate::history::History;
use crate::link::News;
use shared_types::payload::{Rejection, status_bits};
use shared_types::{Channel, Estimate, Status, Truth};
use std::collections::VecDeque;

/// How far back a count that grew is news (ns).
pub const RECENT_NS: u64 = 10_000_000_000;
/// How long a status bit of a single estimate is shown (ns).
pub const BIT_SHOWN_NS: u64 = 2_000_000_000;
/// Estimates that wait for the true state at their instant; the service keeps no more for a slow reader.
const PENDING: usize = shared_types::service::ESTIMATE_BUFFER;
/// Over which the error against the truth is averaged (ns).
const TRUTH_AVERAGE_NS: f64 = 2e9;
/// A truth that is older than this tells nothing about now (ns).
const TRUTH_SHOWN_NS: u64 = 2_000_000_000;

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

    /// Its report within an estimate.
    pub fn channel(self, estimate: &Estimate) -> &Channel {
        [&estimate.translation, &estimate.rotation, &estimate.linear][self as usize]
    }

    /// The bit that says that it coasts.
    pub fn coasting_bit(self) -> u64 {
        use status_bits::{COASTING_LINEAR, COASTING_ROTATION, COASTING_TRANSLATION};
        [COASTING_TRANSLATION, COASTING_ROTATION, COASTING_LINEAR][self as usize]
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
    /// Each component over time.
    pub histories: Vec<History>,
    /// The least range that a picture of it spans, so that noise looks like noise.
    pub least_span: f64,
    /// Which part of the estimate it belongs to.
    pub part: Part,
    read: fn(&Estimate) -> Vec<f64>,
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
    ) -> Self {
        let histories = vec![History::default(); axes.len()];
        Self { name, axes, now: vec![0.0; axes.len()], histories, least_span, part, read, used: 0 }
    }

    fn note(&mut self, estimate: &Estimate) {
        self.now = (self.read)(estimate);
        for (k, (history, &value)) in self.histories.iter_mut().zip(&self.now).enumerate() {
            history.note(estimate.publish_stamp_ns, value);
            if value != 0.0 {
                self.used = self.used.max(k + 1);
            }
        }
    }

    /// How many components are shown: of a linear plant, whose size nobody tells, those that were ever other than zero.
    pub fn n_shown(&self) -> usize {
        if self.part == Part::Linear { self.used.max(1) } else { self.axes.len() }
    }
}

static XYZ: [&str; 3] = ["x", "y", "z"];
static RPY: [&str; 3] = ["r", "p", "y"];
static NUMBERS: [&str; 12] = ["1", "2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12"];

fn vectors() -> Vec<Vector> {
    use Part::{Linear, Rotation, Translation};
    vec![
        Vector::new(Translation, "position m", &XYZ, 0.5, |e| e.position_m.to_vec()),
        Vector::new(Translation, "velocity m/s", &XYZ, 0.2, |e| e.velocity_m_s.to_vec()),
        Vector::new(Rotation, "attitude deg", &RPY, 2.0, |e| e.euler_rad.map(f64::to_degrees).to_vec()),
        Vector::new(Rotation, "rates deg/s", &XYZ, 2.0, |e| {
            e.angular_velocity_rad_s.map(f64::to_degrees).to_vec()
        }),
        Vector::new(Translation, "learned N", &XYZ, 0.5, |e| e.matched_force_n.to_vec()),
        Vector::new(Rotation, "learned N·m", &XYZ, 0.02, |e| e.matched_torque_n_m.to_vec()),
        Vector::new(Linear, "state", &NUMBERS, 1e-3, |e| e.state.to_vec()),
        Vector::new(Linear, "learned f", &NUMBERS[..6], 1e-3, |e| e.matched_input.to_vec()),
    ]
}

/// Root mean squares of the estimate's error against the truth, over some two seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthError {
    /// Position (m).
    pub position_m: f64,
    /// Velocity (m/s).
    pub velocity_m_s: f64,
    /// Attitude, the angle of the rotation between the two (rad).
    pub attitude_rad: f64,
    /// Angular velocity (rad/s).
    pub angular_velocity_rad_s: f64,
    /// Learned force against the true one (N).
    pub force_n: f64,
    /// Learned torque against the true one (N·m).
    pub torque_n_m: f64,
}

/// Where the service is.
#[derive(Debug, Clone, PartialEq)]
pub enum Presence {
    /// Nothing was heard yet.
    Unknown,
    /// Estimates come.
    Here,
    /// None comes.
    Away {
        /// CLOCK_MONOTONIC of the newest estimate, or of the first look (ns).
        since_ns: u64,
        /// What was found, and what to do.
        why: String,
    },
}

/// All that a view shows.
#[derive(Debug, Clone)]
pub struct Model {
    /// Whose.
    pub instance: String,
    /// The newest estimate of all time.
    pub estimate: Option<Estimate>,
    /// The newest status.
    pub status: Option<Status>,
    /// Where the service is.
    pub presence: Presence,
    /// How often the service was seen to start anew.
    pub restarts: u64,
    /// State and learned force over time.
    pub vectors: Vec<Vector>,
    /// ‖ỹ‖ of each channel over time.
    pub output_errors: [History; 3],
    /// ‖f̂_N‖ of each channel over time.
    pub native_norms: [History; 3],
    /// Which channels were ever reported.
    configured: [bool; 3],
    /// When each status bit was seen last (ns).
    bits_seen_ns: [u64; 64],
    /// Statuses of the last [`RECENT_NS`], of this run of the service.
    statuses: VecDeque<Status>,
    pending: VecDeque<Estimate>,
    truth: Option<Truth>,
    squares: Option<[f64; 6]>,
    squared_to_ns: u64,
}

impl Model {
    /// A model that knows nothing yet.
    pub fn new(instance: &str) -> Self {
        Self {
            instance: instance.into(),
            estimate: None,
            status: None,
            presence: Presence::Unknown,
            restarts: 0,
            vectors: vectors(),
            output_errors: Default::default(),
            native_norms: Default::default(),
            configured: [false; 3],
            bits_seen_ns: [0; 64],
            statuses: VecDeque::new(),
            pending: VecDeque::new(),
            truth: None,
            squares: None,
            squared_to_ns: 0,
        }
    }

    /// Takes what the link has brought.
    pub fn note(&mut self, news: News) {
        match news {
            News::Estimate(estimate) => self.note_estimate(&estimate),
            News::Status(status) => self.note_status(status),
            News::Truth(truth) => self.note_truth(&truth),
            News::Away { since_ns, why } => self.presence = Presence::Away { since_ns, why },
        }
    }

    fn note_estimate(&mut self, estimate: &Estimate) {
        // A reader that comes late hears the newest estimate of a dead service once more.
        if self.estimate.is_some_and(|newest| newest.publish_stamp_ns >= estimate.publish_stamp_ns) {
            return;
        }
        let at_ns = estimate.publish_stamp_ns;
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
            self.native_norms[k].note(at_ns, channel.native_norm);
        }
        for vector in &mut self.vectors {
            vector.note(estimate);
        }
        self.pending.push_back(*estimate);
        if self.pending.len() > PENDING {
            self.pending.pop_front();
        }
    }

    fn note_status(&mut self, status: Status) {
        if let Some(before) = &self.status {
            if status.stamp_ns <= before.stamp_ns {
                return;
            }
            if status.start_stamp_ns != before.start_stamp_ns {
                self.restarts += 1;
                self.statuses.clear();
            }
        }
        while self.statuses.front().is_some_and(|old| status.stamp_ns - old.stamp_ns > RECENT_NS) {
            self.statuses.pop_front();
        }
        self.statuses.push_back(status);
        self.status = Some(status);
    }

    /// Compares the estimates since the truth before with the truth between the two.
    fn note_truth(&mut self, truth: &Truth) {
        let before = self.truth.replace(*truth);
        let Some(before) = before.filter(|before| before.stamp_ns < truth.stamp_ns) else { return };
        while let Some(estimate) = self.pending.front().filter(|e| e.stamp_ns <= truth.stamp_ns) {
            if estimate.stamp_ns >= before.stamp_ns {
                let part =
                    (estimate.stamp_ns - before.stamp_ns) as f64 / (truth.stamp_ns - before.stamp_ns) as f64;
                let squares = squared_errors(estimate, &before, truth, part);
                let step_ns = estimate.stamp_ns.saturating_sub(self.squared_to_ns) as f64;
                let share = (step_ns / TRUTH_AVERAGE_NS).clamp(0.0, 1.0);
                let means = self.squares.get_or_insert(squares);
                for (mean, square) in means.iter_mut().zip(squares) {
                    *mean += share * (square - *mean);
                }
                self.squared_to_ns = estimate.stamp_ns;
            }
            self.pending.pop_front();
        }
    }

    /// The error against the truth, while a simulator publishes it.
    pub fn truth_error(&self) -> Option<TruthError> {
        let newest_ns = self.estimate?.stamp_ns;
        if newest_ns.saturating_sub(self.squared_to_ns) > TRUTH_SHOWN_NS {
            return None;
        }
        let [position_m, velocity_m_s, attitude_rad, angular_velocity_rad_s, force_n, torque_n_m] =
            self.squares?.map(f64::sqrt);
        Some(TruthError {
            position_m,
            velocity_m_s,
            attitude_rad,
            angular_velocity_rad_s,
            force_n,
            torque_n_m,
        })
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
        let counts = Rejection::ALL.map(|reason| (reason, status.rejected(reason)));
        let mut counts: Vec<_> = counts.into_iter().filter(|&(_, count)| count > 0).collect();
        counts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        counts
    }

    /// Age of the newest estimate (ns).
    pub fn estimate_age_ns(&self, now_ns: u64) -> Option<u64> {
        Some(now_ns.saturating_sub(self.estimate?.publish_stamp_ns))
    }

    /// Whether an operator has frozen adaptation, by what was heard last.
    pub fn is_frozen(&self) -> bool {
        self.estimate.is_some_and(|estimate| estimate.status & status_bits::FROZEN != 0)
    }
}

/// Squared distances of position, velocity, attitude, angular velocity, force and torque from the truth that lies
/// `part` of the way between two.
fn squared_errors(estimate: &Estimate, before: &Truth, after: &Truth, part: f64) -> [f64; 6] {
    let between = |a: f64, b: f64| a + part * (b - a);
    let square = |estimate: [f64; 3], read: fn(&Truth) -> [f64; 3]| {
        let (a, b) = (read(before), read(after));
        (0..3).map(|k| (estimate[k] - between(a[k], b[k])).powi(2)).sum::<f64>()
    };
    // The angle between two unit quaternions, of which either sign means the same attitude.
    let dot = |a: &[f64; 4], b: &[f64; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (a, b) = (before.attitude_wxyz, after.attitude_wxyz);
    let sign = dot(&a, &b).signum();
    let mut truth: [f64; 4] = std::array::from_fn(|k| between(a[k], sign * b[k]));
    let norm = dot(&truth, &truth).sqrt();
    truth = truth.map(|component| component / norm);
    let cosine = dot(&truth, &estimate.attitude_wxyz).abs().min(1.0);
    [
        square(estimate.position_m, |truth| truth.position_m),
        square(estimate.velocity_m_s, |truth| truth.velocity_m_s),
        (2.0 * cosine.acos()).powi(2),
        square(estimate.angular_velocity_rad_s, |truth| truth.angular_velocity_rad_s),
        square(estimate.matched_force_n, |truth| truth.matched_force_n),
        square(estimate.matched_torque_n_m, |truth| truth.matched_torque_n_m),
    ]
}
