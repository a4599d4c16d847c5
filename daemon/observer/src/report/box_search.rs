//! The supremum of a function over a box, by branch and bound: the largest value found, and an upper bound.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The largest value of a function over a box.
#[derive(Debug, Clone, PartialEq)]
pub struct Supremum {
    /// The largest value found.
    pub value: f64,
    /// Where it is taken, in the unit of the box.
    pub at: Vec<f64>,
    /// An upper bound on the function in the box.
    pub upper_bound: f64,
    /// Points evaluated.
    pub evaluations: usize,
}

/// The box around a point, and an upper bound on the function in it.
struct Cell {
    upper_bound: f64,
    center: Vec<f64>,
    half_widths: Vec<f64>,
}

impl PartialEq for Cell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Cell {}
impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Cell {
    fn cmp(&self, other: &Self) -> Ordering {
        self.upper_bound.total_cmp(&other.upper_bound)
    }
}

/// A search ends once the upper bound is this close to the value found, relative to it.
const TOLERANCE: f64 = 1e-3;
/// The best points of the division from which a local search starts, at most.
const LOCAL_STARTS: usize = 16;
/// A local search ends after this many evaluations.
const CLIMB: usize = 600;
/// Cells that are divided together: their halves are one batch.
const CELLS_AT_ONCE: usize = 4;

/// Branch and bound over the box with these corners, then local searches from the best points found.
///
/// `values(points)` is the function at several points, which may cost little more than at one. `modulus(ρ)` bounds
/// `|f(y) − f(z)|` for y and z of a weighted distance ρ, each axis multiplied by its entry of `weights`: what makes the
/// upper bound one. Deterministic; at most about twice `most_evaluations`.
pub(crate) fn supremum_over_box(
    (lower, upper): (&[f64], &[f64]),
    weights: &[f64],
    modulus: impl Fn(f64) -> f64,
    most_evaluations: usize,
    mut values: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) -> Supremum {
    let mut evaluations = 0;
    let mut best: Vec<(f64, Vec<f64>)> = Vec::new();
    let mut cells = BinaryHeap::new();
    let center = lower.iter().zip(upper).map(|(a, b)| 0.5 * (a + b)).collect();
    let half_widths: Vec<f64> = lower.iter().zip(upper).map(|(a, b)| 0.5 * (b - a)).collect();
    let mut new_cells: (Vec<Vec<f64>>, Vec<Vec<f64>>) = (vec![center], vec![half_widths.clone()]);
    let bound = loop {
        let (centers, half_widths) = std::mem::take(&mut new_cells);
        evaluations += centers.len();
        for ((value, center), half_widths) in values(&centers).into_iter().zip(centers).zip(half_widths) {
            let place = best.partition_point(|(known, _)| *known >= value);
            if place < LOCAL_STARTS {
                best.insert(place, (value, center.clone()));
                best.truncate(LOCAL_STARTS);
            }
            let radius = half_widths.iter().zip(weights).map(|(h, w)| (h * w).powi(2)).sum::<f64>().sqrt();
            cells.push(Cell { upper_bound: value + modulus(radius), center, half_widths });
        }
        let bound = cells.peek().map_or(f64::INFINITY, |top| top.upper_bound);
        if bound <= best[0].0 * (1.0 + TOLERANCE) || evaluations >= most_evaluations {
            break bound;
        }
        for cell in std::iter::from_fn(|| cells.pop()).take(CELLS_AT_ONCE) {
            let width = |&axis: &usize| cell.half_widths[axis] * weights[axis];
            let axis = (0..weights.len()).max_by(|a, b| width(a).total_cmp(&width(b)));
            let axis = axis.expect("a box has at least one axis");
            for side in [-0.5, 0.5] {
                let (mut center, mut half_widths) = (cell.center.clone(), cell.half_widths.clone());
                center[axis] += side * half_widths[axis];
                half_widths[axis] *= 0.5;
                new_cells.0.push(center);
                new_cells.1.push(half_widths);
            }
        }
    };
    let (mut value, mut at) = best[0].clone();
    let starts = (most_evaluations / CLIMB).clamp(2, LOCAL_STARTS);
    for (start_value, start) in best.into_iter().take(starts) {
        let mut climb = Climb { value: start_value, at: start };
        evaluations += climb.run((lower, upper), &half_widths, &mut values);
        if climb.value > value {
            (value, at) = (climb.value, climb.at);
        }
    }
    Supremum { value, at, upper_bound: bound.max(value), evaluations }
}

/// A compass search: along the best axis by a step that is cut when no direction climbs.
struct Climb {
    value: f64,
    at: Vec<f64>,
}

impl Climb {
    fn run(
        &mut self,
        (lower, upper): (&[f64], &[f64]),
        half_widths: &[f64],
        values: &mut impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> usize {
        let mut evaluations = 0;
        let mut step = 1.0 / 16.0;
        while step > 1e-8 && evaluations < CLIMB {
            let trial = |direction: usize| {
                let (axis, sign) = (direction / 2, if direction.is_multiple_of(2) { -step } else { step });
                let mut trial = self.at.clone();
                trial[axis] = (trial[axis] + sign * half_widths[axis]).clamp(lower[axis], upper[axis]);
                trial
            };
            let trials: Vec<_> = (0..2 * self.at.len()).map(trial).collect();
            evaluations += trials.len();
            let climbed = values(&trials).into_iter().zip(trials).max_by(|a, b| a.0.total_cmp(&b.0));
            match climbed.filter(|(value, _)| *value > self.value) {
                Some((value, at)) => (self.value, self.at) = (value, at),
                None => step *= 0.25,
            }
        }
        evaluations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn each(f: impl Fn(&[f64]) -> f64) -> impl FnMut(&[Vec<f64>]) -> Vec<f64> {
        move |points| points.iter().map(|y| f(y)).collect()
    }

    /// A sum of cosines with its maximum inside, Lipschitz with constant √(1 + 9).
    #[test]
    fn a_known_maximum_is_found_and_bounded() {
        let f = |y: &[f64]| (y[0] - 0.3).cos() + (3.0 * y[1] + 0.2).cos();
        let found = supremum_over_box(
            (&[-1.0, -1.0], &[1.0, 1.0]),
            &[1.0, 1.0],
            |rho| 10.0_f64.sqrt() * rho,
            20_000,
            each(f),
        );
        assert!((found.value - 2.0).abs() < 1e-9, "{found:?}");
        assert!((found.at[0] - 0.3).abs() < 1e-4 && (found.at[1] + 0.2 / 3.0).abs() < 1e-4);
        assert!(found.upper_bound >= 2.0 && found.upper_bound < 2.01, "{found:?}");
    }

    /// The bound holds where the budget ends the search long before it is sharp, and where the maximum is a
    /// needle that no evaluation meets.
    #[test]
    fn the_bound_is_one_even_when_the_search_misses() {
        let needle = |y: &[f64]| (1.0 - 50.0 * (y[0] - 0.123_456).abs()).max(0.0);
        for budget in [3, 10, 100] {
            let found = supremum_over_box((&[-1.0], &[1.0]), &[1.0], |rho| 50.0 * rho, budget, each(needle));
            assert!(found.upper_bound >= 1.0, "{found:?}");
        }
    }

    #[test]
    fn a_box_without_extent_is_a_point() {
        let found = supremum_over_box((&[2.0], &[2.0]), &[1.0], |rho| rho, 100, each(|y| y[0]));
        assert_eq!((found.value, found.at, found.upper_bound), (2.0, vec![2.0], 2.0));
    }
}
