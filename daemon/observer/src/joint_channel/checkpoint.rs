//! What a checkpoint of a joint channel holds, and how a channel continues from one.

use super::JointChannel;
use super::history::JointHistory;
use crate::law::joint::state::{JointScalars, JointState};
use crate::plant::attitude_filter::JointPose;
use serde::{Deserialize, Serialize};

/// The state of a joint channel at a checkpoint: everything that later estimates depend on, except the numbers of
/// `JointState::write`, which stay in the channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct JointChannelState<K> {
    stamp_ns: u64,
    scalars: JointScalars,
    /// E, g and whether ψ̄ was begun.
    excitation: (f64, f64, bool),
    history: JointHistory,
    /// v̂ and r̂, which are among the numbers, too.
    pub(crate) velocity: [f64; 3],
    pub(crate) position: [f64; 3],
    pub(crate) pose: K,
}

impl<K> JointChannelState<K> {
    /// Stamp of the newest sample (ns); `None` before the first output.
    pub(crate) fn stamp_ns(&self) -> Option<u64> {
        self.scalars.is_started.then_some(self.stamp_ns)
    }
}

impl<K: JointPose> JointChannel<K> {
    pub(crate) fn n_learned(&self) -> usize {
        self.saved.len()
    }

    /// The numbers of the checkpoint from `from` on, as many as `into` has room for.
    pub(crate) fn read_saved(&self, from: usize, into: &mut [f64]) {
        let end = self.saved.len().min(from + into.len());
        into[..end - from].copy_from_slice(&self.saved[from..end]);
    }

    /// Saves what is estimated by now as the checkpoint, and returns the rest of it. No allocation.
    ///
    /// # Cost
    /// A copy of 3 n²/2 numbers.
    pub(crate) fn save(&mut self) -> JointChannelState<K> {
        let state = &mut self.at.state;
        state.write(self.filter.n, &mut self.saved);
        JointChannelState {
            stamp_ns: self.at.stamp_ns,
            scalars: state.scalars,
            excitation: (state.excitation.variation, state.excitation.teaching, state.excitation.is_started),
            history: self.history,
            velocity: state.velocity(),
            position: state.position(),
            pose: self.at.pose,
        }
    }

    /// Restores the checkpoint, from which the channel coasts to the present; without the state that goes with it, its weights.
    pub(crate) fn restore(&mut self, saved: Option<&JointChannelState<K>>) {
        self.at.state.read(self.filter.n, &self.saved);
        self.put_back(saved);
    }

    /// Continues from the checkpoint of another channel of the same design. With its state, the next step is the same to the
    /// bit; without, the weights are those of another day.
    pub(crate) fn load(&mut self, learned: &[f64], saved: Option<&JointChannelState<K>>) {
        self.at.state.read(self.filter.n, learned);
        self.put_back(saved);
    }

    /// Room for this many marks. Allocates.
    pub(crate) fn reserve_marks(&mut self, n_marks: usize) {
        self.marks = vec![(self.at.clone(), self.history); n_marks];
    }

    /// Bytes of a mark.
    pub(crate) fn bytes_of_mark(&self) -> usize {
        self.filter.bytes_of_state()
    }

    /// Copies the present into a mark. No allocation.
    pub(crate) fn mark(&mut self, place: usize) {
        if let Some((moment, history)) = self.marks.get_mut(place) {
            (moment.stamp_ns, moment.pose, *history) = (self.at.stamp_ns, self.at.pose, self.history);
            moment.state.copy_from(&self.at.state);
        }
    }

    /// Becomes what it was at a mark, to the bit. No allocation.
    pub(crate) fn return_to(&mut self, place: usize) {
        let Some((moment, history)) = self.marks.get(place) else { return };
        (self.at.stamp_ns, self.at.pose, self.history) = (moment.stamp_ns, moment.pose, *history);
        self.at.state.copy_from(&moment.state);
        self.ahead_steps = None;
    }

    fn put_back(&mut self, saved: Option<&JointChannelState<K>>) {
        self.ahead_steps = None;
        let Some(saved) = saved else {
            self.filter.doubt(&mut self.at.state);
            self.begin();
            return;
        };
        let state: &mut JointState = &mut self.at.state;
        state.scalars = saved.scalars;
        let excitation = &mut state.excitation;
        (excitation.variation, excitation.teaching, excitation.is_started) = saved.excitation;
        self.history = saved.history;
        (self.at.stamp_ns, self.at.pose) = (saved.stamp_ns, saved.pose);
    }
}
