//! How well centers cover their box: sup P_N, fill distance, separation. Only for reports, since each takes many evaluations.

use crate::report::box_search::{Supremum, supremum_over_box};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::native_space::{FeatureBuffers, NativeSpace};
use crate::space::scaled_kernel::LengthScale;

impl NativeSpace {
    /// sup P_N over the box of the centers.
    ///
    /// The value found by a search, and a bound that no point exceeds: P_N(y) is the distance of 𝔎(y,·) from
    /// H_N, hence `|P_N(y) − P_N(z)| ≤ ‖𝔎(y,·) − 𝔎(z,·)‖ = √(2κ(0) − 2𝔎(y, z))`. Over all of ℝ^d, as the paper
    /// prints it, the supremum is always √κ(0): no finite set of centers covers an unbounded space.
    ///
    /// # Cost
    /// Some hundred to some ten thousand evaluations of the features: for reports.
    pub fn sup_power_function(&self) -> Supremum {
        let n = self.n_centers();
        let mut buffers = FeatureBuffers::new(self);
        let kernel = self.kernel();
        let found = self.search(
            |rho| (2.0 * (kernel.value_at_zero() - kernel.radial().value(rho))).max(0.0).sqrt(),
            n * n,
            |points| self.power_functions_at(points, &mut buffers),
        );
        // Nowhere is it more than far from all centers.
        Supremum { upper_bound: found.upper_bound.min(kernel.value_at_zero().sqrt()), ..found }
    }

    /// The fill distance `h = sup_y min_j |y − ξ_j|` over the box of the centers, in length scales.
    pub fn fill_distance(&self) -> Supremum {
        let mut buffers = FeatureBuffers::new(self);
        let mut nearest = |y: &Vec<f64>| self.distance_to_nearest_center(y, &mut buffers);
        self.search(|rho| rho, self.n_centers(), |points| points.iter().map(&mut nearest).collect())
    }

    /// The separation distance `q = ½ min_{i≠j} |ξ_i − ξ_j|`, in length scales; `None` for a single center.
    pub fn separation(&self) -> Option<f64> {
        self.centers()
            .closest_pair(self.kernel().inverse_length_scales())
            .map(|(_, _, distance)| 0.5 * distance)
    }

    fn search(
        &self,
        modulus: impl Fn(f64) -> f64,
        cost: usize,
        values: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Supremum {
        // Half a second or so on a slow core up to N = 1000; beyond, the power function takes as N²: seconds at 4096.
        let max_evaluations = (400_000_000 / cost.max(1)).clamp(1000, 100_000);
        supremum_over_box(
            self.bounding_box(),
            self.kernel().inverse_length_scales(),
            modulus,
            max_evaluations,
            values,
        )
    }
}

/// What another length scale would do to a space.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LengthScaleEffect {
    /// Times the length scale of the design.
    pub factor: f64,
    /// cond(K); `None` where K is not numerically positive definite.
    pub gram_condition: Option<f64>,
    /// sup P_N / √κ(0) over the box of the centers.
    pub relative_power_function: Option<f64>,
}

/// cond(K) and sup P_N / √κ(0) for multiples of the length scale: the longer, the better the cover and the worse
/// the condition.
pub fn length_scale_effect(
    kernel: Kernel,
    length_scale: &LengthScale,
    centers: &Centers,
    nugget: f64,
    factors: &[f64],
) -> Vec<LengthScaleEffect> {
    let effect = |&factor: &f64| {
        let space = NativeSpace::new(kernel, &length_scale.scaled(factor), centers.clone(), nugget).ok();
        LengthScaleEffect {
            factor,
            gram_condition: space.as_ref().map(NativeSpace::gram_condition),
            relative_power_function: space
                .as_ref()
                .map(|space| space.sup_power_function().value / space.value_at_zero().sqrt()),
        }
    };
    factors.iter().map(effect).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_longer_length_scale_covers_better_and_conditions_worse() {
        let kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };
        let centers = Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap();
        let factors = [0.5, 1.0, 2.0];
        let effects = length_scale_effect(kernel, &LengthScale::Isotropic(1.0), &centers, 0.0, &factors);
        for pair in effects.windows(2) {
            assert!(pair[0].gram_condition < pair[1].gram_condition);
            assert!(pair[0].relative_power_function > pair[1].relative_power_function);
        }
    }
}
