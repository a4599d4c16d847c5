//! A part of a velocity in body axes, of a Doppler log with two axes or of a log of the speed ahead, in inertial axes.
//!
//! The measured components k see the innovation R_k·(y − Rᵀv̂), which is G e of the error e of v̂ in inertial axes, G = R D Rᵀ with D
//! the measured components. One axis after the other is read out of it:
//!
//! ```text
//! y_i = v̂_i + (G e)_i/G_ii,   r = Σ_{j≠i} |G_ij| σ_j / G_ii,   σ² = (r² + Σ_k R_ik² σ_k²/G_ii²)/(1 − 2r/σ_i)
//! ```
//!
//! with σ_j the deviations of v̂. r is the error of the other axes, in the worst case: it is not white, and the covariances of the
//! axes do not hold how it goes with that of this one. An update with K = P/(P + σ²) leaves an error whose variance is at most (1 − K) P
//! whatever that is: ((1−K) σ_i + K r)² + K² (σ² (1 − 2r/σ_i) − r²) ≤ (1−K) σ_i². An axis with 2r ≥ σ_i learns nothing from it.

use nalgebra::{Matrix3, Vector3};

/// Below this share of an axis it is not measured.
const LEAST_SHARE: f64 = 1e-3;

/// A velocity and its deviations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a> {
    pub(super) value: &'a Vector3<f64>,
    pub(super) std: &'a [f64; 3],
}

/// By inertial axis, the velocity and its deviation that a part of `body` (body axes) tells, with `predicted` in inertial axes; `None` of
/// an axis of which it tells nothing. `rotation` turns body axes into inertial ones.
pub(super) fn of_body(
    rotation: &Matrix3<f64>,
    body: Known,
    missing: &[bool; 3],
    predicted: Known,
) -> [Option<(f64, f64)>; 3] {
    let measured = Vector3::from(missing.map(|missing| f64::from(u8::from(!missing))));
    let seen = rotation * Matrix3::from_diagonal(&measured) * rotation.transpose();
    let innovation = rotation * measured.component_mul(&(body.value - rotation.tr_mul(predicted.value)));
    std::array::from_fn(|i| {
        let share = seen[(i, i)];
        if share < LEAST_SHARE {
            return None;
        }
        let others = (0..3).filter(|j| *j != i).map(|j| seen[(i, j)].abs() * predicted.std[j]);
        let others = others.sum::<f64>() / share;
        let noise = (0..3).map(|k| measured[k] * (rotation[(i, k)] * body.std[k]).powi(2)).sum::<f64>();
        let new = 1.0 - 2.0 * others / predicted.std[i];
        let variance = (others * others + noise / (share * share)) / new;
        (new > LEAST_SHARE).then(|| (predicted.value[i] + innovation[i] / share, variance.sqrt()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    const PREDICTED: Vector3<f64> = Vector3::new(0.4, -0.3, 0.1);

    fn read(turn: Vector3<f64>, missing: [bool; 3], std: [f64; 3]) -> [Option<(f64, f64)>; 3] {
        let rotation = UnitQuaternion::new(turn).to_rotation_matrix().into_inner();
        let truth = Vector3::new(1.0, 2.0, 0.1);
        let body = rotation.transpose() * truth;
        let (body, predicted) =
            (Known { value: &body, std: &[0.01; 3] }, Known { value: &PREDICTED, std: &std });
        of_body(&rotation, body, &missing, predicted)
    }

    #[test]
    fn of_a_level_vehicle_a_horizontal_log_tells_the_horizontal_velocity_as_it_is() {
        for heading in [0.0, 0.7, -2.0] {
            let [x, y, z] = read(Vector3::z() * heading, [false, false, true], [0.5; 3]);
            let ((x, of_x), (y, of_y)) = (x.unwrap(), y.unwrap());
            assert!((x - 1.0).abs() < 1e-12 && (y - 2.0).abs() < 1e-12 && z.is_none());
            assert!((of_x - 0.01).abs() < 1e-12 && (of_y - 0.01).abs() < 1e-12);
        }
    }

    /// Ahead of a vehicle that heads between two axes, the sum of both is measured: neither is told, until one is much better known.
    #[test]
    fn what_two_axes_share_goes_to_the_one_that_is_less_known() {
        let ahead = [false, true, true];
        let between = Vector3::z() * std::f64::consts::FRAC_PI_4;
        assert_eq!(read(between, ahead, [0.5; 3]), [None; 3]);
        let [x, y, _] = read(between, ahead, [0.5, 0.05, 0.5]);
        let (x, std) = x.unwrap();
        assert!(y.is_none() && (x - PREDICTED.x - (1.0 - PREDICTED.x) - (2.0 - PREDICTED.y)).abs() < 1e-12);
        let wanted = ((0.05_f64.powi(2) + 2.0 * 0.01_f64.powi(2)) / (1.0 - 2.0 * 0.05 / 0.5)).sqrt();
        assert!((std - wanted).abs() < 1e-12);
    }

    /// The promise of the deviation: with the worst correlation, of either sign, P after the update is not too small.
    #[test]
    fn the_variance_after_an_update_covers_any_correlation() {
        let turned = Vector3::new(0.2, -0.15, 0.9);
        let std = [0.3, 0.2, 0.25];
        for (i, told) in read(turned, [false, false, true], std).into_iter().enumerate() {
            let Some((_, sigma)) = told else { continue };
            let rotation = UnitQuaternion::new(turned).to_rotation_matrix().into_inner();
            let seen = rotation * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * rotation.transpose();
            let gain = std[i] * std[i] / (std[i] * std[i] + sigma * sigma);
            let of_noise =
                (0..2).map(|k| (rotation[(i, k)] * 0.01).powi(2)).sum::<f64>() / seen[(i, i)].powi(2);
            for signs in 0..8 {
                // Errors of the axes that go together, each with either sign.
                let error = Vector3::from_fn(|j, _| if signs >> j & 1 == 0 { std[j] } else { -std[j] });
                let left = error[i] - gain * (seen * error)[i] / seen[(i, i)];
                assert!(left * left + gain * gain * of_noise <= (1.0 - gain) * std[i] * std[i] * 1.000_001);
            }
        }
    }
}
