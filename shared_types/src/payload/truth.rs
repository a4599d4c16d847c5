//! The truth, which a simulator publishes for comparison: the state of the true plant.

use crate::table::{WXYZ, XYZ};
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

payload! {
    /// The true plant at `stamp_ns`, from the simulator.
    #[derive(Default, Serialize, Deserialize)]
    pub struct Truth: "observer.Truth.v1" {
        /// Sequence of the sample taken at the same time.
        sequence: u64,
        /// Time of the state (ns).
        stamp_ns: u64,
        /// Position, inertial (m).
        position_m: [f64; 3] { components: XYZ },
        /// Velocity, inertial (m/s).
        velocity_m_s: [f64; 3] { components: XYZ },
        /// Attitude, unit quaternion w, x, y, z, body to inertial.
        attitude_wxyz: [f64; 4] { components: WXYZ },
        /// Angular velocity, body axes (rad/s).
        angular_velocity_rad_s: [f64; 3] { components: XYZ },
        /// f: everything that the nominal plant leaves out and that depends on the motion, inertial (N).
        matched_force_n: [f64; 3] { components: XYZ },
        /// f of the rotation, body axes (N·m).
        matched_torque_n_m: [f64; 3] { components: XYZ },
        /// ξ: gusts and the like, which are no function of the motion, inertial (N).
        unmatched_force_n: [f64; 3] { components: XYZ },
        /// ξ of the rotation, body axes (N·m).
        unmatched_torque_n_m: [f64; 3] { components: XYZ },
    }
}
