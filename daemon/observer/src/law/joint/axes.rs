//! The axes of the features: inertial, or those of the body.
//!
//! In body axes ψ is a function of Rᵀv and Rᵀa_u, and the weights turn with the body: held along inertial axes, they are θ := ΔR θ whenever
//! it has turned by ΔR. The covariance stays as it is: it is that of every axis alike, or nearly. What the turn makes of its
//! cross terms between velocity and weights is left out, which are as old as the gain's memory.
//!
//! Then there are three more features, σ_c ω × v: an added mass A makes the force −ω × A v, which is nothing else than a drag of the
//! turning vehicle to a model without it.
//!
//! A drag that differs along the vehicle's axes, an added mass, a wing are functions of the body's axes; wind and current, and the
//! errors of a commanded force that is told along inertial axes, are not.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Attitude and angular velocity of the body.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Axes {
    /// Body to inertial; `None`: the features are along inertial axes, or the attitude was not told yet.
    attitude: Option<UnitQuaternion<f64>>,
    /// ω, body axes (rad/s).
    pub(crate) rate: [f64; 3],
}

impl Axes {
    /// Numbers that a checkpoint keeps of them: the weights mean nothing without.
    pub(crate) const N_NUMBERS: usize = 4;

    pub(crate) fn of_features(&self, inertial: &[f64; 3]) -> [f64; 3] {
        match &self.attitude {
            None => *inertial,
            Some(attitude) => (attitude.inverse() * Vector3::from(*inertial)).into(),
        }
    }

    /// Becomes those of this attitude; what the body has turned by since, along inertial axes.
    pub(crate) fn turn(&mut self, attitude: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let before = self.attitude.replace(*attitude);
        before.map_or(*attitude, |before| attitude * before.inverse())
    }

    pub(crate) fn numbers(&self) -> [f64; Self::N_NUMBERS] {
        self.attitude.map_or([0.0; 4], |attitude| [attitude.w, attitude.i, attitude.j, attitude.k])
    }

    pub(crate) fn of_numbers(numbers: &[f64]) -> Self {
        let attitude = match numbers {
            &[w, x, y, z] if [w, x, y, z] != [0.0; 4] => {
                Some(UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)))
            }
            _ => None,
        };
        Self { attitude, rate: [0.0; 3] }
    }
}
