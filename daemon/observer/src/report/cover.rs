//! How well centers cover their box: sup P_N, fill distance, separation. For reports: each takes many evaluations.

use crate::report::box_search::{Supremum, supremum_over_box};
use crate::space::native_space::{FeatureBuffers, NativeSpace};

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
