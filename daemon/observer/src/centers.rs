//! Kernel centers: the points of the output space around which the unknown force is learned.

use crate::DesignError;
use crate::Parameter;

/// N distinct points of ℝ³, in the output's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Centers {
    points: Vec<[f64; 3]>,
}

impl Centers {
    /// A lattice that fills the box from `lower` to `upper`, corners included; one point along an axis
    /// lies in its middle. The last axis runs fastest.
    ///
    /// # Errors
    /// `Centers` where a number is not finite, an axis has no points, or an axis with several points has
    /// no length.
    pub fn lattice(lower: [f64; 3], upper: [f64; 3], per_axis: [usize; 3]) -> Result<Self, DesignError> {
        for axis in 0..3 {
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
        let mut points = Vec::with_capacity(per_axis.iter().product());
        for i in 0..per_axis[0] {
            for j in 0..per_axis[1] {
                points.extend((0..per_axis[2]).map(|k| [at(0, i), at(1, j), at(2, k)]));
            }
        }
        Ok(Self { points })
    }

    /// The given points.
    ///
    /// # Errors
    /// `Centers` where there is none, or one is not finite. Equal ones are found by the Gram matrix.
    pub fn listed(points: Vec<[f64; 3]>) -> Result<Self, DesignError> {
        let not_finite = points.iter().position(|point| point.iter().any(|c| !c.is_finite()));
        match (points.is_empty(), not_finite) {
            (true, _) => Err(DesignError::new(Parameter::Centers, "no centers".into(), "at least one")),
            (_, Some(index)) => {
                let found = format!("center {} is {:?}", index + 1, points[index]);
                Err(DesignError::new(Parameter::Centers, found, "finite coordinates"))
            }
            _ => Ok(Self { points }),
        }
    }

    /// The points, in the order of all vectors of length N.
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// N.
    pub fn n_centers(&self) -> usize {
        self.points.len()
    }

    /// The smallest box around the centers: its lower and its upper corner.
    pub fn bounding_box(&self) -> ([f64; 3], [f64; 3]) {
        let fold = |pick: fn(f64, f64) -> f64, start: f64| {
            std::array::from_fn(|axis| self.points.iter().fold(start, |best, point| pick(best, point[axis])))
        };
        (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY))
    }

    /// The two centers nearest to each other, counted from 1, and their distance; `None` for a single one.
    ///
    /// # Cost
    /// N²/2 distances: for messages, not for steps.
    pub fn closest_pair(&self) -> Option<(usize, usize, f64)> {
        let mut closest: Option<(usize, usize, f64)> = None;
        for (j, b) in self.points.iter().enumerate() {
            for (i, a) in self.points[..j].iter().enumerate() {
                let distance = (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
                if closest.is_none_or(|(_, _, least)| distance < least) {
                    closest = Some((i + 1, j + 1, distance));
                }
            }
        }
        closest
    }
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
        assert_eq!(centers.points(), expected);
        assert_eq!(centers.bounding_box(), ([-1.0, 0.0, 2.0], [1.0, 0.0, 4.0]));
    }

    #[test]
    fn impossible_centers_are_refused() {
        assert!(Centers::lattice([0.0; 3], [1.0, 0.0, 1.0], [2, 2, 2]).is_err());
        assert!(Centers::lattice([0.0; 3], [1.0; 3], [2, 0, 2]).is_err());
        assert!(Centers::listed(vec![]).is_err());
        assert!(Centers::listed(vec![[0.0, f64::NAN, 0.0]]).is_err());
    }

    #[test]
    fn the_closest_pair_is_named() {
        let centers =
            Centers::listed(vec![[0.0; 3], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 0.5, 0.0]]).unwrap();
        assert_eq!(centers.closest_pair(), Some((2, 4, 0.5)));
    }
}
