//! Kernel centers: the points of the output space around which the unknown force is learned.

use crate::error::{DesignError, Parameter};
use std::sync::Arc;

/// A lattice of more centers is taken for a mistake.
const MAX_CENTERS: usize = 100_000_000;

/// Ξ_N: N distinct points of ℝ^d, d the number of outputs, in the output's unit.
///
/// # Source
/// Niu et al., §II.
#[derive(Debug, Clone, PartialEq)]
pub struct Centers {
    dimension: usize,
    /// Point after point, d numbers each.
    coordinates: Arc<[f64]>,
    lattice: Option<LatticeBox>,
}

/// A lattice: the box that it fills, and the number of points along each axis.
#[derive(Debug, Clone, PartialEq)]
pub struct LatticeBox {
    /// One corner, in the output's unit.
    pub lower: Vec<f64>,
    /// The other corner.
    pub upper: Vec<f64>,
    /// Points along each axis.
    pub per_axis: Vec<usize>,
}

impl Centers {
    /// A lattice that fills the box from `lower` to `upper`, corners included; one point along an axis
    /// lies in its middle. The last axis runs fastest.
    ///
    /// # Errors
    /// `Centers` where the three have not the same length, a number is not finite, an axis has no points, or
    /// an axis with several points has no length.
    pub fn lattice(
        lower: impl AsRef<[f64]>,
        upper: impl AsRef<[f64]>,
        per_axis: impl AsRef<[usize]>,
    ) -> Result<Self, DesignError> {
        let (lower, upper, per_axis) = (lower.as_ref(), upper.as_ref(), per_axis.as_ref());
        let dimension = per_axis.len();
        if dimension == 0 || lower.len() != dimension || upper.len() != dimension {
            return Err(DesignError::new(
                Parameter::Centers,
                format!(
                    "corners of {} and {} numbers for {dimension} numbers of centers per axis",
                    lower.len(),
                    upper.len()
                ),
                "one number per output in each",
            ));
        }
        for axis in 0..dimension {
            let (a, b, n) = (lower[axis], upper[axis], per_axis[axis]);
            if !a.is_finite() || !b.is_finite() || n == 0 || (n > 1 && b <= a) {
                return Err(DesignError::new(
                    Parameter::Centers,
                    format!("{n} centers from {a} to {b} along axis {}", axis + 1),
                    "at least one center per axis, finite corners, and lower < upper where there are several",
                ));
            }
        }
        let at = |axis: usize, i: usize| match per_axis[axis] {
            1 => 0.5 * (lower[axis] + upper[axis]),
            n => lower[axis] + (upper[axis] - lower[axis]) * i as f64 / (n - 1) as f64,
        };
        let n_centers = per_axis.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
        let Some(n_centers) = n_centers.filter(|&n| n <= MAX_CENTERS) else {
            let found = format!("{per_axis:?} centers per axis");
            return Err(DesignError::new(Parameter::Centers, found, format!("at most {MAX_CENTERS} in all")));
        };
        let mut coordinates = Vec::with_capacity(n_centers * dimension);
        for index in 0..n_centers {
            let mut below = n_centers;
            let mut rest = index;
            for (axis, n) in per_axis.iter().enumerate() {
                below /= n;
                coordinates.push(at(axis, rest / below));
                rest %= below;
            }
        }
        let lattice =
            LatticeBox { lower: lower.to_vec(), upper: upper.to_vec(), per_axis: per_axis.to_vec() };
        Ok(Self { dimension, coordinates: coordinates.into(), lattice: Some(lattice) })
    }

    /// The given points.
    ///
    /// # Errors
    /// `Centers` where there is none, two have not the same number of coordinates, or one is not finite. Equal
    /// ones are found by the Gram matrix.
    pub fn listed<Point: AsRef<[f64]>>(points: impl AsRef<[Point]>) -> Result<Self, DesignError> {
        let points = points.as_ref();
        let refuse = |found: String, needed: &str| Err(DesignError::new(Parameter::Centers, found, needed));
        let Some(dimension) = points.first().map(|first| first.as_ref().len()).filter(|&d| d > 0) else {
            return refuse("no centers".into(), "at least one");
        };
        for (index, point) in points.iter().enumerate() {
            let point = point.as_ref();
            if point.len() != dimension {
                let found =
                    format!("center {} has {} numbers, the first {dimension}", index + 1, point.len());
                return refuse(found, "one number per output in each");
            }
            if point.iter().any(|c| !c.is_finite()) {
                return refuse(format!("center {} is {point:?}", index + 1), "finite coordinates");
            }
        }
        let coordinates = points.iter().flat_map(|p| p.as_ref()).copied().collect();
        Ok(Self { dimension, coordinates, lattice: None })
    }

    /// The points, in the order of all vectors of length N.
    pub fn points(&self) -> impl ExactSizeIterator<Item = &[f64]> + Clone {
        self.coordinates.chunks_exact(self.dimension)
    }

    /// The lattice that they were made as; `None` for listed centers.
    pub fn lattice_box(&self) -> Option<&LatticeBox> {
        self.lattice.as_ref()
    }

    /// d.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// N.
    pub fn n_centers(&self) -> usize {
        self.coordinates.len() / self.dimension
    }

    /// The smallest box around the centers: its lower and its upper corner.
    pub fn bounding_box(&self) -> (Vec<f64>, Vec<f64>) {
        let fold = |pick: fn(f64, f64) -> f64, start: f64| {
            (0..self.dimension)
                .map(|axis| self.points().fold(start, |best, point| pick(best, point[axis])))
                .collect()
        };
        (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY))
    }

    /// The two centers nearest to each other, counted from 1, and their distance with each axis multiplied by
    /// its entry of `weights`; `None` for a single center.
    ///
    /// # Cost
    /// N²/2 distances: for messages and reports, not for steps.
    pub fn closest_pair(&self, weights: &[f64]) -> Option<(usize, usize, f64)> {
        let mut closest: Option<(usize, usize, f64)> = None;
        for (j, b) in self.points().enumerate() {
            for (i, a) in self.points().take(j).enumerate() {
                let distance = weighted_distance(a, b, weights);
                if closest.is_none_or(|(_, _, least)| distance < least) {
                    closest = Some((i + 1, j + 1, distance));
                }
            }
        }
        closest
    }
}

/// `√Σ_i (w_i (a_i − b_i))²`.
pub(crate) fn weighted_distance(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    let squares = a.iter().zip(b).zip(weights).map(|((a, b), w)| (w * (a - b)).powi(2));
    squares.sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_fills_its_box() {
        let centers = Centers::lattice([-1.0, 0.0, 2.0], [1.0, 0.0, 4.0], [3, 1, 2]).unwrap();
        let expected = [
            [-1.0, 0.0, 2.0],
            [-1.0, 0.0, 4.0],
            [0.0, 0.0, 2.0],
            [0.0, 0.0, 4.0],
            [1.0, 0.0, 2.0],
            [1.0, 0.0, 4.0],
        ];
        assert_eq!(centers.points().collect::<Vec<_>>(), expected);
        assert_eq!(centers.bounding_box(), (vec![-1.0, 0.0, 2.0], vec![1.0, 0.0, 4.0]));
    }

    #[test]
    fn impossible_centers_are_refused() {
        assert!(Centers::lattice([0.0; 3], [1.0, 0.0, 1.0], [2, 2, 2]).is_err());
        assert!(Centers::lattice([0.0; 3], [1.0; 3], [2, 0, 2]).is_err());
        assert!(Centers::lattice([0.0; 2], [1.0; 3], [2, 2, 2]).is_err());
        assert!(Centers::listed::<[f64; 3]>([]).is_err());
        assert!(Centers::listed([[0.0, f64::NAN, 0.0]]).is_err());
        assert!(Centers::listed([vec![0.0, 1.0], vec![0.0]]).is_err());
    }

    #[test]
    fn the_closest_pair_is_named() {
        let centers = Centers::listed([[0.0; 3], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 0.5, 0.0]]).unwrap();
        assert_eq!(centers.closest_pair(&[1.0; 3]), Some((2, 4, 0.5)));
        assert_eq!(centers.closest_pair(&[1.0, 100.0, 1.0]), Some((1, 2, 3.0)));
    }
}
