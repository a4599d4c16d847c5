//! A channel on a time line: which law holds when, from the samples' own stamps alone.
//!
//! Between two samples the estimate follows from the stamps, not from when somebody asks: an output is
//! held for at most `hold_s`, then the channel coasts on a grid of steps from there. So any reader, any tick
//! rate and any replay gets the same bits for the same samples and the same instant. The longer a coast, the
//! longer its steps: the work for a late question or a late sample stays bounded.
//!
//! The weights' update belongs to the next sample, whose stamp tells how long the output was held; until
//! then it is carried along as a pending increment.

use crate::DesignError;
use crate::channel::{Channel, ChannelDesign, Learning, Segment};
use nalgebra::Vector3;

/// What is integrated from a channel's output: a position, or an attitude.
pub(crate) trait Kinematics: Copy {
    /// The pose after a segment that starts at `start_ns`.
    fn after(&self, segment: &Segment, start_ns: u64) -> Self;
}

/// Output and pose at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment<K> {
    pub(crate) stamp_ns: u64,
    pub(crate) rate: Vector3<f64>,
    pub(crate) pose: K,
}

impl<K: Kinematics> Moment<K> {
    fn after(&self, segment: &Segment, stamp_ns: u64) -> Self {
        Self { stamp_ns, rate: segment.end, pose: self.pose.after(segment, self.stamp_ns) }
    }
}

/// A point of the coasting grid, with f̂ and φᵀφ there.
#[derive(Debug, Clone, Copy)]
struct GridPoint<K> {
    /// Counts from the end of the hold.
    index: u64,
    moment: Moment<K>,
    matched_force: Vector3<f64>,
    squared_features: f64,
}

/// What a channel says about an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prediction<K> {
    pub(crate) moment: Moment<K>,
    pub(crate) matched_force: Vector3<f64>,
    pub(crate) squared_features: f64,
    pub(crate) learning: Learning,
    pub(crate) coasting: bool,
}

/// Forces that need no learning, added to the input.
#[derive(Debug, Clone, Copy)]
pub(crate) enum KnownForce {
    /// Gravity, buoyancy.
    Constant(Vector3<f64>),
    /// −ω × Iω, from the estimate at the start of a step.
    Gyroscopic(nalgebra::Matrix3<f64>),
}

impl KnownForce {
    fn at(&self, rate: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Constant(force) => *force,
            Self::Gyroscopic(inertia) => -rate.cross(&(inertia * rate)),
        }
    }
}

/// The newest points of the coasting grid. A sample that comes late, but not later than this many steps,
/// goes on from the one before it; an older one coasts again from the start, to the same bits.
const TRAIL: usize = 32;
/// After every so many steps of a coast, a step is twice as long,
const STEPS_OF_ONE_LENGTH: u64 = 32;
/// but not longer than this: f̂ is evaluated once a step.
const LONGEST_STEP_NS: u64 = 250_000_000;

#[derive(Debug, Clone)]
pub(crate) struct Timeline<K> {
    pub(crate) channel: Channel,
    known_force: KnownForce,
    hold_ns: u64,
    coast_step_ns: u64,
    /// The state just after the newest sample; `None` before the first output.
    committed: Option<Moment<K>>,
    /// Output estimate at the first output; `None` takes the output itself.
    initial_rate: Option<Vector3<f64>>,
    initial_pose: K,
    /// Pose before the first output: the initial one, and fixes.
    waiting_pose: K,
    input: Vector3<f64>,
    held_until_ns: u64,
    last_learning_clamped: bool,
    output_stamp_ns: Option<u64>,
    trail: [Option<GridPoint<K>>; TRAIL],
    trail_end: usize,
}

impl<K: Kinematics> Timeline<K> {
    /// A timeline for a channel of this design, before its first output.
    pub(crate) fn new(
        design: ChannelDesign,
        known_force: KnownForce,
        initial_rate: Option<Vector3<f64>>,
        initial_pose: K,
    ) -> Result<Self, DesignError> {
        Ok(Self {
            known_force,
            hold_ns: nanoseconds(design.hold_s),
            coast_step_ns: nanoseconds(design.coast_step_s).max(1),
            channel: Channel::new(design)?,
            committed: None,
            initial_rate,
            initial_pose,
            waiting_pose: initial_pose,
            input: Vector3::zeros(),
            held_until_ns: 0,
            last_learning_clamped: false,
            output_stamp_ns: None,
            trail: [None; TRAIL],
            trail_end: 0,
        })
    }

    /// Moves to the stamp of a new sample, learns from the output held until then, and takes what the
    /// sample brings.
    pub(crate) fn accept(
        &mut self,
        stamp_ns: u64,
        output: Option<Vector3<f64>>,
        input: Option<Vector3<f64>>,
        take_fix: impl FnOnce(&mut K),
    ) {
        match (self.committed, output) {
            (Some(committed), _) => {
                let moment = self.predict(stamp_ns).moment;
                let learning = self.channel.learning(self.held_h_s(&committed, stamp_ns));
                self.channel.learn(&learning);
                self.last_learning_clamped = learning.clamped;
                self.committed = Some(moment);
            }
            (None, Some(output)) => {
                let rate = self.initial_rate.unwrap_or(output);
                self.committed = Some(Moment { stamp_ns, rate, pose: self.waiting_pose });
            }
            (None, None) => {}
        }
        self.input = input.unwrap_or(self.input);
        take_fix(match &mut self.committed {
            Some(moment) => &mut moment.pose,
            None => &mut self.waiting_pose,
        });
        if let Some(moment) = &self.committed {
            if let Some(output) = output {
                self.channel.observe(&output, &moment.rate);
                self.held_until_ns = stamp_ns.saturating_add(self.hold_ns);
                self.output_stamp_ns = Some(stamp_ns);
            } else if self.held_until_ns > stamp_ns {
                self.channel.observe_again(&moment.rate);
            }
        }
        self.trail = [None; TRAIL];
    }

    /// The estimate at `to_ns`, not before the newest sample. Changes nothing but the coasting grid.
    pub(crate) fn predict(&mut self, to_ns: u64) -> Prediction<K> {
        let Some(committed) = self.committed else {
            return Prediction {
                moment: Moment {
                    stamp_ns: to_ns,
                    rate: self.initial_rate.unwrap_or_default(),
                    pose: self.waiting_pose,
                },
                matched_force: Vector3::zeros(),
                squared_features: 0.0,
                learning: Learning::default(),
                coasting: true,
            };
        };
        let to_ns = to_ns.max(committed.stamp_ns);
        let held_end_ns = self.held_until_ns.max(committed.stamp_ns);
        if to_ns <= self.held_until_ns {
            return self.hold(&committed, to_ns);
        }
        let held = self.hold(&committed, held_end_ns);
        let mut point = match self.newest_grid_point(to_ns) {
            Some(point) => point,
            None => self.grid_point(0, held.moment, &held.learning),
        };
        loop {
            let next_ns = point.moment.stamp_ns + self.step_ns(point.index);
            if next_ns > to_ns {
                break;
            }
            let moment = self.coast(&point, next_ns);
            point = self.grid_point(point.index + 1, moment, &held.learning);
        }
        Prediction {
            moment: if point.moment.stamp_ns == to_ns { point.moment } else { self.coast(&point, to_ns) },
            matched_force: point.matched_force,
            squared_features: point.squared_features,
            learning: Learning::default(),
            coasting: true,
        }
    }

    /// How long the output has been held since the newest sample, at `to_ns`.
    fn held_h_s(&self, committed: &Moment<K>, to_ns: u64) -> f64 {
        seconds(to_ns.min(self.held_until_ns).saturating_sub(committed.stamp_ns))
    }

    fn hold(&self, committed: &Moment<K>, to_ns: u64) -> Prediction<K> {
        let h_s = self.held_h_s(committed, to_ns);
        let learning = self.channel.learning(h_s);
        let matched_force = self.channel.matched_force(&learning);
        let moment = if h_s == 0.0 {
            *committed
        } else {
            let force = self.input + self.known_force.at(&committed.rate) + matched_force;
            committed.after(&self.channel.follow(&committed.rate, &force, h_s), to_ns)
        };
        let squared_features = self.channel.squared_features();
        let clamped = learning.clamped || self.last_learning_clamped;
        let learning = Learning { clamped, ..learning };
        Prediction { moment, matched_force, squared_features, learning, coasting: false }
    }

    fn grid_point(&mut self, index: u64, moment: Moment<K>, pending: &Learning) -> GridPoint<K> {
        let (matched_force, squared_features) = self.channel.matched_force_at(&moment.rate, pending);
        let point = GridPoint { index, moment, matched_force, squared_features };
        self.trail[self.trail_end] = Some(point);
        self.trail_end = (self.trail_end + 1) % TRAIL;
        point
    }

    /// Length of the step from the grid point of this index.
    fn step_ns(&self, index: u64) -> u64 {
        let doublings = (index / STEPS_OF_ONE_LENGTH).min(20);
        (self.coast_step_ns << doublings).min(LONGEST_STEP_NS.max(self.coast_step_ns))
    }

    fn newest_grid_point(&self, to_ns: u64) -> Option<GridPoint<K>> {
        let before = self.trail.iter().flatten().filter(|point| point.moment.stamp_ns <= to_ns);
        before.max_by_key(|point| point.moment.stamp_ns).copied()
    }

    fn coast(&self, point: &GridPoint<K>, to_ns: u64) -> Moment<K> {
        let rate = &point.moment.rate;
        let force = self.input + self.known_force.at(rate) + point.matched_force;
        let h_s = seconds(to_ns - point.moment.stamp_ns);
        point.moment.after(&self.channel.coast(rate, &force, h_s), to_ns)
    }

    /// Stamp of the newest output, if there was one.
    pub(crate) fn output_stamp_ns(&self) -> Option<u64> {
        self.output_stamp_ns
    }

    /// The state just after the newest sample, if an output ever came.
    pub(crate) fn committed(&self) -> Option<Moment<K>> {
        self.committed
    }

    /// Puts the state back to an earlier one, from which it coasts to now.
    pub(crate) fn put_back(&mut self, moment: Option<Moment<K>>) {
        self.committed = moment;
        self.held_until_ns = 0;
        self.trail = [None; TRAIL];
    }

    /// Forgets the state, not what was learned: starts again from the next output, at any stamp.
    pub(crate) fn restart(&mut self) {
        self.waiting_pose = self.initial_pose;
        self.output_stamp_ns = None;
        self.input = Vector3::zeros();
        self.last_learning_clamped = false;
        self.put_back(None);
    }
}

pub(crate) fn seconds(duration_ns: u64) -> f64 {
    duration_ns as f64 / 1e9
}

fn nanoseconds(duration_s: f64) -> u64 {
    (duration_s * 1e9).round() as u64
}
