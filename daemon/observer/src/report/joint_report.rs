//! What can be said of a channel with the joint law before it flies: what its sensors tell, and how large its deviations become.

use crate::error::DesignError;
use crate::joint_channel::{
    JointChannel, JointChannelDesign, JointRotationDesign, JointSample, JointTranslationDesign,
};
use crate::law::joint::teaches::Teaches;
use crate::plant::attitude_filter::{AttitudeFilter, JointPose};
use nalgebra::{UnitQuaternion, Vector3};

/// The figures are those after this time of flight (s),
const FLIGHT_S: f64 = 10.0;
/// and at the end of coasts of these lengths from there (s).
const COASTS_S: [f64; 3] = [0.5, 2.0, 10.0];
/// Of an output that is held for so many of its periods.
const HOLD_PERIODS: f64 = 1.5;
/// The flight from which the figures are: a part of the box's half-widths, at these angular frequencies (rad/s).
const SHARE_OF_BOX: f64 = 0.5;
const TRANSLATION_RAD_S: [f64; 3] = [0.9, 0.7, 1.1];
const ROTATION_RAD_S: [f64; 3] = [3.0, 2.3, 1.7];

/// What is known of a channel with the joint law before it flies.
#[derive(Debug, Clone, PartialEq)]
pub struct JointReport {
    /// What no sensor of velocity tells, and what does, in words.
    pub unobservable: Vec<&'static str>,
    /// n: velocity, disturbance, weights, position.
    pub n_rows: usize,
    /// N.
    pub n_centers: usize,
    /// Bytes that every step reads: one P.
    pub bytes: usize,
    /// Bytes that are held.
    pub memory_bytes: usize,
    /// cond(K).
    pub gram_condition: f64,
    /// After [`ExpectedStd::coast_s`] without outputs, commands known; the first is without a coast.
    pub expected_std: Vec<ExpectedStd>,
}

/// Deviations that are to be expected: those that the law computes on a smooth flight through half of the box with the
/// configured noises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedStd {
    /// Since the newest output (s).
    pub coast_s: f64,
    /// Of the velocity (m/s; rad/s).
    pub output: [f64; 3],
    /// Of the position without fixes since the start (m), or of the attitude with one in every sample before the coast (rad).
    pub pose: [f64; 3],
    /// Of the unknown force (N) or torque (N·m).
    pub force: [f64; 3],
}

impl JointReport {
    /// Of a translation.
    ///
    /// # Errors
    /// As [`JointChannel::translation`].
    pub fn of_translation(design: &JointTranslationDesign) -> Result<Self, DesignError> {
        let quiet =
            JointTranslationDesign { channel: configured_noises_stand(&design.channel), ..design.clone() };
        let channel = JointChannel::translation(&quiet, None, None)?;
        let hidden = vec!["position (until position fixes come)"];
        let force = -design.known_force_n;
        let fly = |_: &Vector3<f64>| None::<fn(&mut ())>;
        let pose_std = |_: &(), position_std: [f64; 3]| position_std;
        Ok(Self::of(channel, &design.channel, (hidden, TRANSLATION_RAD_S, force), fly, pose_std))
    }

    /// Of a rotation.
    ///
    /// # Errors
    /// As [`JointChannel::rotation`].
    pub fn of_rotation(design: &JointRotationDesign) -> Result<Self, DesignError> {
        let quiet =
            JointRotationDesign { channel: configured_noises_stand(&design.channel), ..design.clone() };
        let channel = JointChannel::rotation(&quiet, None, None)?;
        let mut hidden = vec!["attitude (until attitude fixes come)"];
        if design.bias_std_rad_s > 0.0 || design.bias_walk_rad_s_sqrt_s > 0.0 {
            hidden.push("bias of the gyroscope (until attitude fixes come)");
        }
        let std = [design.attitude_noise_rad; 3];
        let fix = move |_: &Vector3<f64>| {
            // The estimate itself: the covariance does not depend on the value.
            Some(move |pose: &mut AttitudeFilter| {
                let same: UnitQuaternion<f64> = pose.attitude;
                pose.take_fix(&same, &std);
            })
        };
        let pose_std = |pose: &AttitudeFilter, _: [f64; 3]| pose.std_rad();
        let no_force = Vector3::zeros();
        Ok(Self::of(channel, &design.channel, (hidden, ROTATION_RAD_S, no_force), fix, pose_std))
    }

    fn of<K: JointPose, F: FnOnce(&mut K)>(
        mut channel: JointChannel<K>,
        design: &JointChannelDesign,
        (unobservable, frequencies, balance): (Vec<&'static str>, [f64; 3], Vector3<f64>),
        fix: impl Fn(&Vector3<f64>) -> Option<F>,
        pose_std: impl Fn(&K, [f64; 3]) -> [f64; 3],
    ) -> Self {
        let period_s = design.hold_s / HOLD_PERIODS;
        let (_, upper) = design.filter.centers.bounding_box();
        let amplitude = Vector3::from_fn(|axis, _| SHARE_OF_BOX * upper[axis]);
        let at = |t_s: f64| {
            let angle = Vector3::from_fn(|axis, _| frequencies[axis] * t_s + axis as f64);
            let velocity = amplitude.component_mul(&angle.map(f64::sin));
            let rates = Vector3::from(frequencies);
            (velocity, amplitude.component_mul(&angle.map(f64::cos)).component_mul(&rates))
        };
        let mut expected_std = Vec::new();
        let n_flight = (FLIGHT_S / period_s).ceil() as u64;
        let n_all = n_flight + (COASTS_S[2] / period_s).ceil() as u64;
        let mut pending = [0.0].into_iter().chain(COASTS_S).peekable();
        for j in 0..=n_all {
            let t_s = j as f64 * period_s;
            let stamp_ns = 1 + (t_s * 1e9) as u64;
            let (velocity, acceleration) = at(t_s);
            let has_output = j <= n_flight;
            let sample = JointSample {
                output: std::array::from_fn(|axis| has_output.then_some(velocity[axis])),
                command: Some(design.inertia * acceleration + balance),
                ..JointSample::default()
            };
            let take_fix = if has_output { fix(&velocity) } else { None };
            channel.accept(stamp_ns, &sample, Teaches::All, take_fix);
            let coast_s = t_s - n_flight as f64 * period_s;
            if pending.next_if(|due_s| coast_s >= *due_s - 1e-9).is_some() {
                let estimate = channel.estimate(stamp_ns);
                let prediction = &estimate.prediction;
                expected_std.push(ExpectedStd {
                    coast_s: coast_s.max(0.0),
                    output: prediction.velocity_std,
                    pose: pose_std(&estimate.pose, prediction.position_std),
                    force: estimate.matched_force_std,
                });
            }
        }
        let filter = channel.filter();
        Self {
            unobservable,
            n_rows: filter.n_rows(),
            n_centers: design.filter.centers.n_centers(),
            bytes: filter.bytes_of_step(),
            memory_bytes: channel.bytes(),
            gram_condition: filter.gram_condition(),
            expected_std,
        }
    }
}

fn configured_noises_stand(design: &JointChannelDesign) -> JointChannelDesign {
    let mut design = design.clone();
    design.filter.noise_samples = 0.0;
    design
}
