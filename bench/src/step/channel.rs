//! The channel that is measured: the paper's translation (Niu et al., §VI-C) with Γ = 100 kg/s², on N centers.

use nalgebra::{Matrix3, Vector3};
use observer::{
    Centers, ChannelDesign, DeadZone, DeadZoneShape, DisturbanceBounds, ExcitationDesign, GradientOptions,
    JointChannelDesign, JointDesign, Kernel, LengthScale, LocalSolver, PriorDeviations, Solver,
};
use std::f64::consts::TAU;

pub(super) const KERNEL: Kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };
pub(super) const LENGTH_SCALE: f64 = 1.0;
pub(super) const MASS_KG: f64 = 4.0;
pub(super) const GAIN_PER_S: f64 = 10.0;
pub(super) const ADAPTATION_RATE: f64 = 100.0;
pub(super) const DEAD_ZONE_WIDTH: f64 = 0.01;
pub(super) const STEP_S: f64 = 0.005;
/// u, constant.
pub(super) const INPUT: Vector3<f64> = Vector3::new(2.0, -1.0, 0.5);

pub(super) fn dead_zone() -> anyhow::Result<DeadZone> {
    Ok(DeadZone::new(DeadZoneShape::Saturated, DEAD_ZONE_WIDTH, DEAD_ZONE_WIDTH)?)
}

/// The design on these centers, with the dense solver.
pub(super) fn design(centers: Centers) -> anyhow::Result<ChannelDesign> {
    Ok(ChannelDesign {
        kernel: KERNEL,
        length_scale: LengthScale::Isotropic(LENGTH_SCALE),
        centers,
        nugget: 0.0,
        solver: Solver::Dense,
        inertia: Matrix3::identity() * MASS_KG,
        gain_per_s: GAIN_PER_S,
        adaptation_rate: Matrix3::identity() * ADAPTATION_RATE,
        dead_zone: dead_zone()?,
        options: GradientOptions::default(),
        bounds: DisturbanceBounds::default(),
        hold_s: STEP_S,
        coast_step_s: STEP_S,
    })
}

/// The joint law on these centers, with the defaults of a translation.
pub(super) fn joint_design(centers: Centers) -> JointChannelDesign {
    let filter = JointDesign {
        kernel: KERNEL,
        length_scale: LengthScale::Isotropic(LENGTH_SCALE),
        centers,
        prior: PriorDeviations {
            bias: 0.5,
            linear: 0.3,
            kernel: 0.35,
            input: 0.15,
            lag: 0.3,
            disturbance: 0.1,
        },
        disturbance_time_s: 0.2,
        process_noise: 1.5e-3,
        motion_memory_s: 300.0,
        input_memory_s: 3600.0,
        lags_s: [0.05, 0.2],
        noise: [DEAD_ZONE_WIDTH; 3],
        position_noise: None,
        body_axes: None,
        accelerometer: None,
        noise_samples: 500.0,
        excitation: ExcitationDesign {
            correction_share: 0.3,
            mean_time_s: 5.0,
            variation_time_s: 0.2,
            idle_rate: 0.05,
        },
    };
    JointChannelDesign { filter, inertia: Matrix3::identity() * MASS_KG, hold_s: STEP_S }
}

/// Support of the local solver's Wendland kernel, in spacings of the lattice.
const SUPPORT: f64 = 4.0;

/// The local solver with this block, on a lattice of `edge`³ centers on [−2, 2]³ and Wendland's C² kernel.
pub(super) fn local_design(edge: usize, block: usize) -> anyhow::Result<ChannelDesign> {
    let centers = Centers::lattice([-2.0; 3], [2.0; 3], [edge; 3])?;
    Ok(ChannelDesign {
        kernel: Kernel::WendlandC2,
        length_scale: LengthScale::Isotropic(SUPPORT * 4.0 / (edge - 1) as f64),
        solver: Solver::Local(LocalSolver { block: Some(block), ..LocalSolver::default() }),
        ..design(centers)?
    })
}

/// N centers on [−1, 1]³, and what to call them.
pub(super) fn centers(n_centers: usize) -> anyhow::Result<(Centers, String)> {
    let edge = (n_centers as f64).cbrt().round() as usize;
    if edge.pow(3) == n_centers {
        let lattice = Centers::lattice([-1.0; 3], [1.0; 3], [edge; 3])?;
        return Ok((lattice, format!("lattice {edge}³")));
    }
    // Roberts' R₃ sequence, whose points keep a distance of the order of N^{−1/3}; random ones would come so
    // close that the Gram matrix is singular. The seed is the first point, the middle of the box.
    let ratio = 1.220_744_084_605_759_5_f64; // x⁴ = x + 1
    let point = |i: usize| -> [f64; 3] {
        std::array::from_fn(|axis| 2.0 * (0.5 + i as f64 * ratio.powi(-(axis as i32 + 1))).fract() - 1.0)
    };
    Ok((Centers::listed((0..n_centers).map(point).collect::<Vec<_>>())?, "quasi-random".into()))
}

/// A closed curve through [−0.9, 0.9]³, one output every step of 5 ms. It moves at 2 to 3 m/s², so that an
/// estimate with λ = 10 /s trails it by ten times the dead zone.
pub(super) fn wandering_outputs() -> Vec<Vector3<f64>> {
    const PERIOD: usize = 8192;
    let at = |i: usize| TAU * i as f64 / PERIOD as f64;
    (0..PERIOD)
        .map(|i| {
            0.9 * Vector3::new((13.0 * at(i)).sin(), (17.0 * at(i) + 1.0).sin(), (23.0 * at(i) + 2.0).sin())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use observer::BodyChannel;

    #[test]
    fn centers_that_are_no_cube_are_still_well_separated() {
        for n_centers in [2, 50, 200, 500] {
            let (centers, kind) = centers(n_centers).unwrap();
            assert_eq!((centers.n_centers(), kind.as_str()), (n_centers, "quasi-random"));
            let (.., distance) = centers.closest_pair(&[1.0; 3]).unwrap();
            assert!(distance > 0.5 * (n_centers as f64).cbrt().recip(), "N = {n_centers}: {distance}");
            BodyChannel::new(&design(centers).unwrap()).unwrap();
        }
        assert_eq!(centers(125).unwrap().1, "lattice 5³");
    }
}
