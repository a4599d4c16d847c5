//! Samples of the last while, in the order of their stamps, so that one that arrives late is put where it belongs.
//!
//! Marks hold what the observers were at some of these samples. A late sample is inserted, the observers return to the newest
//! mark before it, and what comes after is fused again. Once all samples of a window are there, the estimate is the same to the
//! bit as if they had come in the order of their stamps.
//!
//! | samples | order |
//! |---|---|
//! | of different stamps | the stamps |
//! | of equal stamps | the sensor's number, the bits of `valid`, then the source, then its sequence |
//!
//! Everything is allocated at the start. With the local solver a mark would be a copy of a million numbers: then there are
//! none, and a late sample is too late.

use crate::estimator::Estimator;
use crate::gate::LinearSample;
use nalgebra::UnitQuaternion;
use observer::{ChannelName, Learn, Sample};
use std::collections::VecDeque;

/// The window holds at most this many samples; beyond, it is shorter.
const MAX_SAMPLES: usize = 4096;
/// The largest number of marks, of which two are beyond the window's ends.
const MAX_MARKS: usize = 32;
/// With fewer marks nothing late can be taken.
const MIN_MARKS: usize = 3;
/// Marks take at most this many bytes together, as far as [`MIN_MARKS`] allows it.
const MAX_BYTES_OF_MARKS: usize = 64 << 20;
/// Samples that are fused again in one tick take about this part of its period,
const PART_OF_PERIOD: f64 = 0.25;
/// if each takes as long as this for every byte of a mark (s), which grows with the square of the rows as a step does; and never
/// more than this many of them. Measured, at 27 centers 8e-11, at 125 3e-11. A constant: a replay fuses in the same ticks.
const TIME_OF_BYTE_S: f64 = 8e-11;
const MAX_FUSED_AGAIN: usize = 512;
const MIN_FUSED_AGAIN: usize = 16;

/// Where a sample belongs: the order in which samples are fused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Its stamp (ns).
    pub stamp_ns: u64,
    /// Number of its sensor.
    pub sensor: u32,
    /// Its valid fields.
    pub valid: u32,
    /// Its source.
    pub source: u128,
    /// Its sequence.
    pub sequence: u64,
}

/// A sample of the window.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    /// Where it belongs.
    pub place: Place,
    /// For the observer of the rigid body.
    pub sample: Sample,
    /// For the observer of a general linear plant.
    pub linear: LinearSample,
    /// Whether an operator froze adaptation when it came.
    pub frozen: bool,
    /// Which channels may learn from it.
    pub teaches: [bool; 3],
    /// Whether the vehicle stands on the ground, if its source ever says so.
    pub on_ground: Option<bool>,
}

/// A sample that was fused.
#[derive(Debug, Clone, Copy)]
pub struct Fused {
    /// Its source.
    pub source: u128,
    /// Which of its outputs were outliers, by channel.
    pub outliers: [bool; 3],
    /// Which of its outputs repeat what cannot be, by a law that knows it.
    pub stuck: [bool; 3],
    /// Normalized innovation squared of its velocity, if it has one; 0 with the gradient law.
    pub velocity_nis: Option<f64>,
}

/// What the observers were after the first samples of the window.
#[derive(Debug, Clone, Copy)]
struct Mark {
    /// Of the channels' marks.
    place_in_channels: usize,
    /// Where the newest of these samples belongs; `None` before the first sample of all.
    newest: Option<Place>,
    /// How many of the window's samples these are.
    n_fused: usize,
    on_ground: bool,
    fixed_attitude: Option<UnitQuaternion<f64>>,
}

/// The samples that may have to be fused again, and what the observers were before.
#[derive(Debug, Clone)]
pub struct Window {
    /// Each with whether it was fused before.
    kept: VecDeque<(Kept, bool)>,
    /// How many of them the observers have fused.
    n_fused: usize,
    /// The oldest first; the first one is where the window begins.
    marks: VecDeque<Mark>,
    n_marks: usize,
    /// The observers have to return to the newest mark before they fuse.
    has_to_return: bool,
    length_ns: u64,
    max_fused_again: usize,
    /// How many samples were fused again in the newest tick.
    n_fused_again: usize,
    newest_ns: Option<u64>,
    on_ground: bool,
}

impl Window {
    /// An empty window of this length (s), for ticks at this rate. Allocates the marks.
    pub fn new(length_s: f64, rate_hz: f64, estimator: &mut Estimator) -> Self {
        let bytes = estimator.bytes_of_mark();
        let n_marks =
            bytes.map_or(0, |bytes| (MAX_BYTES_OF_MARKS / bytes.max(1)).clamp(MIN_MARKS, MAX_MARKS));
        estimator.reserve_marks(n_marks);
        let time_of_sample_s = TIME_OF_BYTE_S * bytes.unwrap_or(0).max(1) as f64;
        let in_a_period = PART_OF_PERIOD / rate_hz / time_of_sample_s;
        let mut window = Self {
            kept: VecDeque::with_capacity(MAX_SAMPLES),
            n_fused: 0,
            marks: VecDeque::with_capacity(MAX_MARKS),
            n_marks,
            has_to_return: false,
            length_ns: (length_s * 1e9) as u64,
            max_fused_again: (in_a_period as usize).clamp(MIN_FUSED_AGAIN, MAX_FUSED_AGAIN),
            n_fused_again: 0,
            newest_ns: None,
            on_ground: false,
        };
        window.begin(estimator, None);
        window
    }

    /// Forgets the samples: the observers' present is where the window begins, after a sample of this stamp (ns).
    pub fn begin(&mut self, estimator: &mut Estimator, newest_ns: Option<u64>) {
        self.kept.clear();
        self.marks.clear();
        (self.n_fused, self.has_to_return, self.newest_ns) = (0, false, newest_ns);
        let last =
            Place { stamp_ns: 0, sensor: u32::MAX, valid: u32::MAX, source: u128::MAX, sequence: u64::MAX };
        self.mark(estimator, newest_ns.map(|stamp_ns| Place { stamp_ns, ..last }));
    }

    /// An older sample than this (ns) is too late.
    pub fn start_ns(&self) -> u64 {
        let Some(newest_ns) = self.newest_ns else { return 0 };
        let first = self.marks.front().map_or(Some(newest_ns), |first| Some(first.newest?.stamp_ns + 1));
        // Without marks, equal stamps are in order.
        newest_ns.saturating_sub(self.length_ns).max(first.unwrap_or(0))
    }

    /// Whether the source has told a valid field of this instant already.
    pub fn holds(&self, place: &Place) -> bool {
        let from = self.kept.partition_point(|(kept, _)| kept.place.stamp_ns < place.stamp_ns);
        let same = self.kept.range(from..).take_while(|(kept, _)| kept.place.stamp_ns == place.stamp_ns);
        same.into_iter()
            .any(|(kept, _)| kept.place.source == place.source && kept.place.valid & place.valid != 0)
    }

    /// Whether there is no room for another sample.
    pub fn is_full(&self) -> bool {
        self.kept.len() == MAX_SAMPLES
    }

    /// How many samples were fused again in the newest tick.
    pub fn n_fused_again(&self) -> usize {
        self.n_fused_again
    }

    /// Whether late samples can be put where they belong.
    pub fn takes_late_samples(&self) -> bool {
        self.n_marks > 0
    }

    /// Whether observers and samples agree.
    pub fn is_caught_up(&self) -> bool {
        self.n_fused == self.kept.len()
    }

    /// Whether the vehicle stands on the ground, by the newest sample that was fused and says it.
    pub fn on_ground(&self) -> bool {
        self.on_ground
    }

    /// Takes over what another window knows.
    pub fn set_on_ground(&mut self, on_ground: bool) {
        self.on_ground = on_ground;
    }

    /// Takes a sample that is not too late; [`Window::fuse`] uses it.
    pub fn insert(&mut self, kept: Kept) {
        self.newest_ns = self.newest_ns.max(Some(kept.place.stamp_ns));
        if self.n_marks == 0 {
            self.forget_before(kept.place.stamp_ns);
            self.kept.push_back((kept, false));
            return;
        }
        let at = self.kept.partition_point(|(other, _)| other.place < kept.place);
        self.kept.insert(at, (kept, false));
        if at < self.n_fused {
            while self.marks.len() > 1 && self.marks.back().is_some_and(|mark| mark.n_fused > at) {
                self.marks.pop_back();
            }
            self.has_to_return = true;
            self.n_fused = self.marks.back().map_or(0, |mark| mark.n_fused);
        }
    }

    fn forget_before(&mut self, stamp_ns: u64) {
        let n_old = self.kept.partition_point(|(kept, _)| kept.place.stamp_ns < stamp_ns).min(self.n_fused);
        self.kept.drain(..n_old);
        self.n_fused -= n_old;
    }

    /// Fuses the samples that are not fused. Those that were fused before are as many as fit into a tick; the rest is for the
    /// next ticks. `see` is told of each sample that is fused for the first time. No allocation.
    pub fn fuse(&mut self, estimator: &mut Estimator, mut see: impl FnMut(&Fused)) {
        if self.has_to_return
            && let Some(mark) = self.marks.back()
        {
            estimator.return_to(mark.place_in_channels, mark.fixed_attitude);
            self.on_ground = mark.on_ground;
            self.has_to_return = false;
        }
        self.n_fused_again = 0;
        while let Some((kept, was_fused)) = self.kept.get_mut(self.n_fused) {
            if *was_fused && self.n_fused_again == self.max_fused_again {
                break;
            }
            self.n_fused_again += usize::from(*was_fused);
            self.on_ground = kept.on_ground.unwrap_or(self.on_ground);
            let learn = Learn { frozen: kept.frozen || self.on_ground, teaches: kept.teaches };
            let outliers = estimator.accept(&kept.sample, &kept.linear, learn);
            let place = kept.place;
            if !std::mem::replace(was_fused, true) {
                let velocity_nis =
                    kept.sample.velocity.and_then(|_| estimator.channel(ChannelName::Translation));
                let velocity_nis = velocity_nis.map(|channel| channel.nis());
                let has_output = [
                    kept.sample.velocity.is_some(),
                    kept.sample.angular_velocity_rad_s.is_some(),
                    kept.linear.output.is_some(),
                ];
                let stuck = ChannelName::ALL.map(|name| {
                    has_output[name as usize]
                        && estimator.channel(name).is_some_and(|channel| channel.is_stuck())
                });
                see(&Fused { source: place.source, outliers, stuck, velocity_nis });
            }
            self.n_fused += 1;
            if self.mark_is_due(place.stamp_ns) {
                self.mark(estimator, Some(place));
            }
        }
    }

    fn mark_is_due(&self, stamp_ns: u64) -> bool {
        let Some(before) = self.marks.back().filter(|_| self.n_marks > 0) else { return false };
        let spacing_ns = self.length_ns / (self.n_marks - 2) as u64;
        before.newest.is_none_or(|before| stamp_ns >= before.stamp_ns.saturating_add(spacing_ns))
            || self.n_fused - before.n_fused >= MAX_SAMPLES / self.n_marks / 2
    }

    /// Makes a mark of the present; the oldest one, and the samples before the next, are forgotten where there is no room.
    fn mark(&mut self, estimator: &mut Estimator, newest: Option<Place>) {
        if self.n_marks == 0 {
            return;
        }
        if self.marks.len() == self.n_marks {
            self.marks.pop_front();
            let n_old = self.marks.front().map_or(0, |first| first.n_fused);
            self.kept.drain(..n_old);
            self.n_fused -= n_old;
            self.marks.iter_mut().for_each(|mark| mark.n_fused -= n_old);
        }
        let is_free = |place: &usize| self.marks.iter().all(|mark| mark.place_in_channels != *place);
        let place_in_channels = (0..self.n_marks).find(is_free).unwrap_or(0);
        estimator.mark(place_in_channels);
        let (n_fused, on_ground) = (self.n_fused, self.on_ground);
        let fixed_attitude = estimator.fixed_attitude();
        self.marks.push_back(Mark { place_in_channels, newest, n_fused, on_ground, fixed_attitude });
    }
}
