//! The estimate, which the service publishes at its rate: the state, and how far it can be trusted.

use crate::table::{EULER, WXYZ, XYZ, numbers_are_finite};
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

constants! {
    /// Bits of [`Estimate::status`].
    pub mod status_bits: u64 with words {
        /// Every configured channel follows measurements that it holds now, and none is reacquiring.
        TRACKING = 1 << 0, "tracking";
        /// The translation channel predicts without a velocity measurement.
        COASTING_TRANSLATION = 1 << 1, "coasting-translation";
        /// The rotation channel predicts without an angular-velocity measurement.
        COASTING_ROTATION = 1 << 2, "coasting-rotation";
        /// A configured channel is stale, or no sample came for longer than `stale_after_s`: do not fly on this. The bits
        /// `STALE_…` say which channel.
        STALE = 1 << 3, "stale";
        /// A channel's dead zone is open: the unknown force is being learned now.
        ADAPTING = 1 << 4, "adapting";
        /// Adaptation was frozen by an operator.
        FROZEN = 1 << 5, "frozen";
        /// The held output lies outside the box of the kernel centers: nothing was learned there.
        OUTSIDE_CENTERS = 1 << 6, "outside-centers";
        /// A sample was rejected since the previous estimate.
        REJECTED_SAMPLE = 1 << 7, "rejected-sample";
        /// The dead zone's output was clamped to the stability bound of the sampled law.
        CLAMPED = 1 << 8, "clamped";
        /// The state was not finite or beyond limits and was reset to the last checkpoint.
        DIVERGED = 1 << 9, "diverged";
        /// No sample was ever accepted: the estimate is the initial state.
        WAITING = 1 << 10, "waiting";
        /// The general linear plant's channel predicts without an output.
        COASTING_LINEAR = 1 << 11, "coasting-linear";
        /// The previous tick ended after its next deadline: the loop is late.
        LATE = 1 << 12, "late";
        /// The loop was late for `deadline.predict_only_after_ticks` ticks in a row: samples are not used, and the estimate is predicted only.
        PREDICT_ONLY = 1 << 13, "predict-only";
        /// The loop was late for so long that the estimate is not to be used at all: do not fly on this.
        INVALID = 1 << 14, "invalid";
        /// An output that is an outlier against its recent errors was held back since the previous estimate.
        HELD_BACK = 1 << 15, "held-back";
        /// A sensor repeats one value to the bit.
        STUCK = 1 << 16, "stuck-sensor";
        /// After an outage, a channel's innovations are not back within the gate: its state is uncertain.
        REACQUIRING = 1 << 17, "reacquiring";
        /// The newest velocity measurement is older than `stale_after_s`, or there was none yet.
        STALE_TRANSLATION = 1 << 18, "stale-translation";
        /// The newest angular-velocity measurement is older than `stale_after_s`, or there was none yet.
        STALE_ROTATION = 1 << 19, "stale-rotation";
        /// The newest output of the general linear plant is older than `stale_after_s`, or there was none yet.
        STALE_LINEAR = 1 << 20, "stale-linear";
        /// The newest sample says that the vehicle stands on the ground: nothing is learned.
        ON_GROUND = 1 << 21, "on-ground";
        /// Samples that arrived late are still being put where they belong: the estimate is predicted from before them.
        CATCHING_UP = 1 << 22, "catching-up";
        /// Any channel coasts.
        COASTING = COASTING_TRANSLATION | COASTING_ROTATION | COASTING_LINEAR;
    }
}

payload! {
    /// How far one channel's estimate can be trusted.
    ///
    /// Units are those of the channel's output: m/s for translation, rad/s for rotation, of the configuration for a
    /// general linear plant; forces N or N·m.
    #[derive(Default, Serialize, Deserialize)]
    pub struct Channel: "observer.Channel.v3" {
        /// ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting.
        output_error: f64,
        /// σ, the dead zone's output now: 0 is closed, nothing is learned.
        activation: f64,
        /// P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing.
        power_function: f64,
        /// ‖f̂_N‖ in the native space.
        native_norm: f64,
        /// How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of its
        /// own error; 0 where the dense one is in use.
        solver_error: f64,
        /// max(d, d_N): the size that the theorems claim ‖e‖ settles below, where their conditions hold (`daemon check`
        /// tells) and the newest output confirms it; else +∞, as while coasting. A bound, not a covariance. +∞ with the
        /// joint law, which has standard deviations instead.
        error_bound: f64,
        /// Time since the stamp of the newest output measurement (s); +∞ before the first.
        output_age_s: f64,
        /// Normalized innovation squared: e²/S of the newest output, mean over its axes. 1 in the mean where the noises are
        /// right; 0 where the law has no S, and before the first output.
        nis: f64,
    }
}

payload! {
    /// The state estimate at `stamp_ns`, and how far it can be trusted.
    #[derive(Default, Serialize, Deserialize)]
    pub struct Estimate: "observer.Estimate.v5" {
        /// Counts the service's publications from 0.
        sequence: u64,
        /// Sequence of the newest sample that went into this estimate.
        source_sequence: u64,
        /// Time of the state (ns).
        stamp_ns: u64,
        /// Stamp of the newest sample that went into this estimate (ns); 0 before the first.
        source_stamp_ns: u64,
        /// CLOCK_MONOTONIC just before publication (ns).
        publish_stamp_ns: u64,
        /// Bits of [`status_bits`].
        status: u64 { words: Some(&status_bits::TABLE) },
        /// Which sensors contributed: bit k is set where a sample of sensor number k was accepted since the estimate before, bit 0
        /// for samples without a sensor number. Numbers above 63 have no bit.
        sensors: u64,
        /// Position, inertial (m). Dead-reckoned from velocity unless position fixes are used.
        position_m: [f64; 3] { components: XYZ },
        /// Velocity, inertial (m/s).
        velocity_m_s: [f64; 3] { components: XYZ },
        /// Attitude, unit quaternion w, x, y, z, body to inertial.
        attitude_wxyz: [f64; 4] { components: WXYZ },
        /// 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
        euler_rad: [f64; 3] { components: EULER },
        /// Angular velocity, body axes (rad/s).
        angular_velocity_rad_s: [f64; 3] { components: XYZ },
        /// f̂: the learned unknown force, inertial axes (N).
        matched_force_n: [f64; 3] { components: XYZ },
        /// f̂: the learned unknown torque, body axes (N·m).
        matched_torque_n_m: [f64; 3] { components: XYZ },
        /// 1 σ of `position_m`, inertial axes (m); +∞ where it is unknown, as each of the next five: with
        /// `law = "gradient"`, and before the first output.
        position_std_m: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// 1 σ of `velocity_m_s`, inertial axes (m/s).
        velocity_std_m_s: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// 1 σ of the rotation vector of the attitude's error, body axes (rad).
        attitude_std_rad: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// 1 σ of `angular_velocity_rad_s`, body axes (rad/s).
        angular_velocity_std_rad_s: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// 1 σ of `matched_force_n`, inertial axes (N).
        matched_force_std_n: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// 1 σ of `matched_torque_n_m`, body axes (N·m).
        matched_torque_std_n_m: [f64; 3] { components: XYZ, may_be_infinite: true },
        /// Trust in position, velocity and force.
        translation: Channel,
        /// Trust in attitude, angular velocity and torque.
        rotation: Channel,
        /// x̂ of a general linear plant, its first n entries, in the units of its configuration.
        state: [f64; 12],
        /// f̂ of a general linear plant, its first m entries.
        matched_input: [f64; 6],
        /// Trust in `state` and `matched_input`.
        linear: Channel,
    }
}

impl Estimate {
    /// Whether every component of state and forces is a finite number, and every deviation a number or +∞.
    pub fn is_finite(&self) -> bool {
        numbers_are_finite(self, 0)
    }

    /// Trust in each channel: translation, rotation, linear plant.
    pub fn channels(&self) -> [&Channel; 3] {
        [&self.translation, &self.rotation, &self.linear]
    }

    /// Whether a general linear plant is estimated; otherwise its fields are zero throughout.
    pub fn has_linear_plant(&self) -> bool {
        let numbers = self.state.iter().chain(&self.matched_input);
        self.linear != Channel::default() || numbers.copied().any(|number| number != 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_words_name_every_bit_once() {
        assert_eq!(status_bits::words(u64::MAX).len(), 23);
        let coasting = ["coasting-translation", "coasting-rotation", "coasting-linear"];
        assert_eq!(status_bits::words(status_bits::COASTING), coasting);
    }

    #[test]
    fn a_deviation_may_be_unknown_but_not_nan() {
        let unknown = Estimate { velocity_std_m_s: [f64::INFINITY; 3], ..Estimate::default() };
        assert!(unknown.is_finite());
        for deviation in [f64::NAN, f64::NEG_INFINITY] {
            assert!(!Estimate { attitude_std_rad: [0.1, deviation, 0.1], ..unknown }.is_finite());
        }
        assert!(!Estimate { position_m: [f64::INFINITY; 3], ..unknown }.is_finite());
    }
}
