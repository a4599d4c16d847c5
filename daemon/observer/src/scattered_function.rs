//! f̂_N on centers that are no lattice, from the neighbours of the output: as on a lattice, but every place has a
//! factor of its own.
//!
//! ```text
//! β += k(y) inᵀ (all N centers, exact),    f̂(y) ≈ β_cᵀ K_c⁻¹ k_c(y),   c: the centers nearest to the center nearest to y
//! ```
//!
//! The neighbours of each center are found once, with a spatial index. K_c is factored when the nearest center changes,
//! which takes some ten times as long as an evaluation; the update and the search for the nearest center visit
//! all N centers, in one vector loop each. For some thousand to some hundred thousand centers; a lattice is faster.
//!
//! The error estimate is the bound of [`crate::lattice_function`], `ρ P_c(y) ‖f̂_N‖`, with ρ three times the largest value
//! found at a sample of places, because they differ. What the farther neighbours know says nothing of those that are
//! left out: unlike on a lattice they may lie on one side only.

use crate::lanes::{LANES, VectorLoop, VectorUnit, dot, multiply_add, whole_lanes};
use crate::learned_function::Evaluation;
use crate::native_space::ScaledKernel;
use crate::{Centers, DesignError, Kernel, LengthScale, LocalSolver, NativeSpace, Parameter};
use nalgebra::SVector;
use pulp::Simd;
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// Beyond all centers, in length scales: what fills up whole lanes.
const FAR: f64 = 1e150;
/// Places at which ρ and the error are found, and updates around each.
const CALIBRATION_PLACES: usize = 32;
const CALIBRATION_UPDATES: usize = 32;
/// What is found there is exceeded elsewhere, by up to this factor.
const SAFETY: f64 = 3.0;
/// Factoring more takes milliseconds, in the step in which the nearest center changes.
const MOST_NEIGHBOURS: usize = 216;
/// The neighbourhood that stands for all centers is so many times as large.
const SURROUNDINGS: usize = 4;

type Point = [f64; 3];
type Index = RTree<GeomWithData<Point, u32>>;

/// A function of H_N with values in ℝ^m, m ≤ 3, as nodal values.
#[derive(Debug, Clone)]
pub(crate) struct ScatteredFunction<const M: usize> {
    geometry: Geometry,
    n_outputs: usize,
    learned: Learned,
    good: Learned,
    held_at: Point,
    held: Evaluation<M>,
    at_output: Neighbourhood,
    at_query: Neighbourhood,
    /// k(y) of the held output, for all centers.
    kernel_vector: Vec<f64>,
    /// Of one neighbourhood, for reports.
    block_space: NativeSpace,
}

#[derive(Debug, Clone)]
struct Learned {
    /// β, one run of whole lanes per output.
    nodal_values: [Vec<f64>; 3],
    /// ‖f̂_N‖², by its recursion.
    squared_norm: f64,
}

/// What does not change.
#[derive(Debug, Clone)]
struct Geometry {
    kernel: ScaledKernel,
    value_at_zero: f64,
    nugget: f64,
    n_centers: usize,
    /// Coordinates of the centers in length scales, one run of whole lanes per axis.
    coordinates: [Vec<f64>; 3],
    /// The nearest centers of each center, nearest first, `n_neighbours` each.
    neighbours: Vec<u32>,
    n_neighbours: usize,
    error_ratio: f64,
    predicted_error: f64,
    dimension: usize,
    unit: VectorUnit,
}

/// The neighbours of one place, their factor, and room to evaluate.
#[derive(Debug, Clone)]
struct Neighbourhood {
    /// The center that they are the neighbours of.
    center: Option<usize>,
    members: Vec<u32>,
    points: Vec<Point>,
    /// R, row after row, each of whole lanes.
    factor: Vec<f64>,
    /// k and β, then φ and θ: four numbers for each neighbour.
    vectors: Vec<[f64; 4]>,
    kernel: Vec<f64>,
    squares: Vec<f64>,
}

/// φᵀφ and θᵀφ.
struct LocalEvaluation {
    squared_features: f64,
    values: [f64; 3],
}

impl<const M: usize> ScatteredFunction<M> {
    /// Zero.
    ///
    /// # Errors
    /// As the lattice's; `Centers` where two are equal.
    pub(crate) fn zero(
        (kernel, length_scale): (Kernel, &LengthScale),
        centers: &Centers,
        nugget: f64,
        options: &LocalSolver,
    ) -> Result<Self, DesignError> {
        let m = centers.dimension();
        options.check(m)?;
        let scaled = ScaledKernel::new(kernel, length_scale, m)?;
        let geometry = Geometry::new(scaled, centers, nugget, options)?;
        let middle = geometry.members(geometry.n_centers / 2);
        let points: Vec<Vec<f64>> =
            middle.iter().map(|&j| centers.points().nth(j as usize).unwrap_or_default().to_vec()).collect();
        let block_space = NativeSpace::new(kernel, length_scale, Centers::listed(points)?, nugget)?;
        let padded = whole_lanes(geometry.n_centers);
        let zeros = || Learned {
            nodal_values: std::array::from_fn(|axis| vec![0.0; if axis < m { padded } else { 0 }]),
            squared_norm: 0.0,
        };
        let neighbourhood = Neighbourhood::new(geometry.n_neighbours, padded);
        Ok(Self {
            n_outputs: m,
            learned: zeros(),
            good: zeros(),
            held_at: [0.0; 3],
            held: Evaluation::exact(SVector::zeros(), 0.0),
            at_output: neighbourhood.clone(),
            at_query: neighbourhood,
            kernel_vector: vec![0.0; padded],
            block_space,
            geometry,
        })
    }

    pub(crate) fn hold(&mut self, output: &[f64]) {
        self.held_at = self.geometry.scaled(output);
    }

    pub(crate) fn held(&mut self) -> Evaluation<M> {
        self.held = evaluate(
            &self.geometry,
            &self.learned,
            &mut self.at_output,
            (self.held_at, self.held_at),
            &SVector::zeros(),
        );
        self.held
    }

    pub(crate) fn at(&mut self, point: &[f64], pending: &SVector<f64, M>) -> Evaluation<M> {
        let point = self.geometry.scaled(point);
        evaluate(&self.geometry, &self.learned, &mut self.at_query, (point, self.held_at), pending)
    }

    pub(crate) fn learn(&mut self, increment: &SVector<f64, M>) {
        let size = increment.norm();
        // As on a lattice.
        let squared_power = (self.geometry.value_at_zero - self.held.squared_features).max(0.0);
        let own = self.held.squared_features + self.geometry.error_ratio.powi(2).min(1.0) * squared_power;
        let squared_norm =
            self.learned.squared_norm + 2.0 * self.held.value.dot(increment) + own * size * size;
        self.learned.squared_norm = squared_norm.max(0.0);
        self.geometry.unit.run(Learn {
            geometry: &self.geometry,
            nodal_values: &mut self.learned.nodal_values[..self.n_outputs],
            at: self.held_at,
            increment,
            kernel_vector: &mut self.kernel_vector,
        });
    }

    pub(crate) fn forget(&mut self) {
        self.learned.nodal_values.iter_mut().for_each(|values| values.fill(0.0));
        self.learned.squared_norm = 0.0;
    }

    pub(crate) fn keep_good_copy(&mut self) {
        copy(&self.learned, &mut self.good);
    }

    pub(crate) fn restore_good_copy(&mut self) {
        copy(&self.good, &mut self.learned);
    }

    pub(crate) fn restore_whole_good_copy(&mut self) {
        self.restore_good_copy();
    }

    pub(crate) fn good_runs(&self) -> impl Iterator<Item = &[f64]> {
        self.good.nodal_values.iter().map(Vec::as_slice)
    }

    pub(crate) fn good_runs_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
        self.good.nodal_values.iter_mut().map(Vec::as_mut_slice)
    }

    pub(crate) fn good_scalars(&self) -> [f64; 1] {
        [self.good.squared_norm]
    }

    pub(crate) fn set_good_scalars(&mut self, [squared_norm]: [f64; 1]) {
        self.good.squared_norm = squared_norm;
    }

    /// ‖f̂_N‖_H by its recursion, in which f̂(y) is the local one.
    pub(crate) fn native_norm(&self) -> f64 {
        self.learned.squared_norm.sqrt()
    }

    /// The space of the neighbours of one center.
    pub(crate) fn space(&self) -> &NativeSpace {
        &self.block_space
    }

    /// Neighbours that an evaluation takes.
    pub(crate) fn n_neighbours(&self) -> usize {
        self.geometry.n_neighbours
    }

    /// RMS of the error over that of f̂, for random histories of updates.
    pub(crate) fn predicted_error(&self) -> f64 {
        self.geometry.predicted_error
    }

    /// Bytes that are held.
    pub(crate) fn bytes(&self) -> usize {
        let padded = whole_lanes(self.geometry.n_centers);
        size_of_val(self.geometry.neighbours.as_slice()) + 8 * padded * (2 * self.n_outputs + 6)
    }

    /// Bytes that a step reads.
    pub(crate) fn bytes_of_step(&self) -> usize {
        let padded = whole_lanes(self.geometry.n_centers);
        8 * padded * (3 + self.n_outputs) + size_of_val(self.at_output.factor.as_slice())
    }
}

fn copy(from: &Learned, to: &mut Learned) {
    for (from, to) in from.nodal_values.iter().zip(&mut to.nodal_values) {
        to.copy_from_slice(from);
    }
    to.squared_norm = from.squared_norm;
}

/// f̂ at `at`, as if `pending` had been learned at `held_at`.
fn evaluate<const M: usize>(
    geometry: &Geometry,
    learned: &Learned,
    neighbourhood: &mut Neighbourhood,
    (at, held_at): (Point, Point),
    pending: &SVector<f64, M>,
) -> Evaluation<M> {
    let center = geometry.nearest(at, &mut neighbourhood.squares);
    if neighbourhood.center != Some(center) {
        neighbourhood.move_to(geometry, geometry.members(center));
        neighbourhood.center = Some(center);
    }
    for (place, (&member, point)) in
        neighbourhood.vectors.iter_mut().zip(neighbourhood.members.iter().zip(&neighbourhood.points))
    {
        *place = [0.0; 4];
        for (beta, values) in place[1..].iter_mut().zip(&learned.nodal_values).filter(|(_, v)| !v.is_empty())
        {
            *beta = values[member as usize];
        }
        if *pending != SVector::<f64, M>::zeros() {
            let k = geometry.kernel_value(point, &held_at);
            place[1..]
                .iter_mut()
                .zip(pending)
                .take(geometry.dimension)
                .for_each(|(beta, increment)| *beta += k * increment);
        }
        place[0] = geometry.kernel_value(point, &at);
    }
    let local = neighbourhood.solve();
    let norm = learned.squared_norm.sqrt() + geometry.value_at_zero.sqrt() * pending.norm();
    let squared_power = (geometry.value_at_zero - local.squared_features).max(0.0);
    let functional = geometry.error_ratio * squared_power.sqrt().max(1e-7 * geometry.value_at_zero.sqrt());
    Evaluation {
        value: SVector::from_fn(|axis, _| if axis < 3 { local.values[axis] } else { 0.0 }),
        squared_features: local.squared_features,
        error: functional * norm,
        error_of_increment: functional * geometry.value_at_zero.sqrt(),
    }
}

impl Neighbourhood {
    fn new(n: usize, padded: usize) -> Self {
        Self {
            center: None,
            members: vec![0; n],
            points: vec![[0.0; 3]; n],
            factor: vec![0.0; n * whole_lanes(n)],
            vectors: vec![[0.0; 4]; n],
            kernel: vec![0.0; n],
            squares: vec![0.0; padded],
        }
    }

    /// Takes other neighbours, and factors their Gram matrix.
    fn move_to(&mut self, geometry: &Geometry, members: &[u32]) {
        self.members.copy_from_slice(members);
        for (point, &member) in self.points.iter_mut().zip(members) {
            *point = geometry.point(member as usize);
        }
        geometry.unit.run(Factor { geometry, neighbourhood: self });
    }

    /// R⁻¹ of k and β by forward substitution, four at a time, and what follows.
    fn solve(&mut self) -> LocalEvaluation {
        let n = self.vectors.len();
        let row_length = whole_lanes(n);
        let mut out = LocalEvaluation { squared_features: 0.0, values: [0.0; 3] };
        for i in 0..n {
            let row = &self.factor[i * row_length..][..=i];
            let (known, rest) = self.vectors.split_at_mut(i);
            let mut sum = rest[0];
            for (r, x) in row.iter().zip(known.iter()) {
                for (sum, x) in sum.iter_mut().zip(x) {
                    *sum -= r * x;
                }
            }
            // A neighbour without a pivot tells nothing that the nearer ones do not.
            let inverse_pivot = if row[i] > 0.0 { row[i].recip() } else { 0.0 };
            rest[0] = sum.map(|sum| sum * inverse_pivot);
            let [phi, theta @ ..] = rest[0];
            out.squared_features += phi * phi;
            for (value, theta) in out.values.iter_mut().zip(theta) {
                *value += theta * phi;
            }
        }
        out
    }

    fn features(&self) -> Vec<f64> {
        self.vectors.iter().map(|[phi, ..]| *phi).collect()
    }
}

impl Geometry {
    fn new(
        kernel: ScaledKernel,
        centers: &Centers,
        nugget: f64,
        options: &LocalSolver,
    ) -> Result<Self, DesignError> {
        if !(nugget.is_finite() && nugget >= 0.0) {
            return Err(DesignError::new(Parameter::Nugget, nugget.to_string(), "a finite number ≥ 0"));
        }
        let (n_centers, dimension) = (centers.n_centers(), centers.dimension());
        let scales = kernel.inverse_length_scales().to_vec();
        let coordinates = std::array::from_fn(|axis| {
            let mut run: Vec<f64> = match scales.get(axis) {
                Some(scale) => centers.points().map(|point| point[axis] * scale).collect(),
                None => vec![0.0; n_centers],
            };
            run.resize(whole_lanes(n_centers), FAR);
            run
        });
        let mut geometry = Self {
            value_at_zero: kernel.value_at_zero(),
            kernel,
            nugget,
            n_centers,
            coordinates,
            neighbours: Vec::new(),
            n_neighbours: 0,
            error_ratio: 0.0,
            predicted_error: 0.0,
            dimension,
            unit: VectorUnit::of_this_machine(),
        };
        let index = RTree::bulk_load(
            (0..n_centers).map(|j| GeomWithData::new(geometry.point(j), j as u32)).collect(),
        );
        let to_try: &[usize] = match dimension {
            1 => &[8, 12],
            2 => &[6, 8, 10],
            _ => &[4, 6],
        };
        let blocks = options.block.as_ref().map_or(to_try, std::slice::from_ref);
        for &points in blocks {
            geometry.n_neighbours = points.pow(dimension as u32).min(n_centers).min(MOST_NEIGHBOURS);
            geometry.calibrate(&index);
            if geometry.predicted_error <= options.accuracy {
                break;
            }
        }
        geometry.neighbours = (0..n_centers)
            .flat_map(|j| geometry.nearest_neighbours(&index, &geometry.point(j), geometry.n_neighbours))
            .collect();
        geometry.refuse_equal_centers()?;
        Ok(geometry)
    }

    fn refuse_equal_centers(&self) -> Result<(), DesignError> {
        for j in 0..self.n_centers {
            let nearest = self.members(j).iter().copied().find(|&other| other as usize != j);
            let Some(nearest) = nearest.map(|nearest| nearest as usize) else { continue };
            if self.point(j) == self.point(nearest) {
                let found = format!("centers {} and {} are equal", j + 1, nearest + 1);
                return Err(DesignError::new(Parameter::Centers, found, "distinct centers"));
            }
        }
        Ok(())
    }

    fn nearest_neighbours(&self, index: &Index, point: &Point, n: usize) -> Vec<u32> {
        index.nearest_neighbor_iter(*point).take(n).map(|neighbour| neighbour.data).collect()
    }

    fn members(&self, center: usize) -> &[u32] {
        &self.neighbours[center * self.n_neighbours..][..self.n_neighbours]
    }

    fn point(&self, center: usize) -> Point {
        std::array::from_fn(|axis| self.coordinates[axis][center])
    }

    fn scaled(&self, point: &[f64]) -> Point {
        let scales = self.kernel.inverse_length_scales();
        std::array::from_fn(|axis| if axis < point.len() { point[axis] * scales[axis] } else { 0.0 })
    }

    fn kernel_value(&self, a: &Point, b: &Point) -> f64 {
        self.kernel.radial().value((0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt())
    }

    /// The center nearest to a point, the first of equals.
    fn nearest(&self, at: Point, squares: &mut [f64]) -> usize {
        self.unit.run(Nearest { coordinates: &self.coordinates, at, squares }).min(self.n_centers - 1)
    }

    /// Finds ρ and the predicted error at a sample of places.
    fn calibrate(&mut self, index: &Index) {
        let (n, n_larger) = (self.n_neighbours, (SURROUNDINGS * self.n_neighbours).min(self.n_centers));
        (self.error_ratio, self.predicted_error) = (0.0, 0.0);
        if n == self.n_centers {
            return;
        }
        let (mut near, mut far) = (Neighbourhood::new(n, 0), Neighbourhood::new(n_larger, 0));
        let (mut errors, mut values, mut error_ratio) = (0.0, 0.0, 0.0_f64);
        for place in 0..CALIBRATION_PLACES {
            let center = (place * self.n_centers + self.n_centers / 2) / CALIBRATION_PLACES % self.n_centers;
            let members = self.nearest_neighbours(index, &self.point(center), n_larger);
            near.move_to(self, &members[..n]);
            far.move_to(self, &members);
            let mut features = |at: &Point| {
                let of = |neighbourhood: &mut Neighbourhood| {
                    for (vector, point) in neighbourhood.vectors.iter_mut().zip(&neighbourhood.points) {
                        *vector = [self.kernel_value(point, at), 0.0, 0.0, 0.0];
                    }
                    let squares = neighbourhood.solve().squared_features;
                    (neighbourhood.features(), (self.value_at_zero - squares).max(0.0))
                };
                (of(&mut near), of(&mut far))
            };
            let middle = |i: usize, j: usize| -> Point {
                let (a, b) = (self.point(members[i] as usize), self.point(members[j] as usize));
                std::array::from_fn(|axis| 0.55 * a[axis] + 0.45 * b[axis])
            };
            // An output is nearer to this center than to others: on the way to one of the next.
            let ((near_at, squared_power), (far_at, smaller_power)) =
                features(&middle(0, 1 + place % (n_larger - 1).clamp(1, 6)));
            if squared_power > 1e-9 * self.value_at_zero {
                let ratio = SAFETY * ((squared_power - smaller_power).max(0.0) / squared_power).sqrt();
                error_ratio = error_ratio.max(ratio);
            }
            for update in 0..CALIBRATION_UPDATES {
                let (i, j) = (update * 7919 % n_larger, (update * 104_729 + 1) % n_larger);
                let ((near_there, _), (far_there, _)) = features(&middle(i, j));
                let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
                let value = product(&far_at, &far_there);
                values += value * value;
                errors += (value - product(&near_at, &near_there)).powi(2);
            }
        }
        (self.error_ratio, self.predicted_error) = (error_ratio, SAFETY * (errors / values).sqrt());
    }
}

/// The index of the smallest squared distance.
struct Nearest<'a> {
    coordinates: &'a [Vec<f64>; 3],
    at: Point,
    squares: &'a mut [f64],
}

impl VectorLoop for Nearest<'_> {
    type Output = usize;

    #[inline(always)]
    fn call<S: Simd>(self, _: S) -> usize {
        squared_distances::<S>(self.coordinates, self.at, self.squares);
        let mut smallest = [f64::INFINITY; LANES];
        for squares in self.squares.as_chunks::<LANES>().0 {
            for (smallest, &square) in smallest.iter_mut().zip(squares) {
                *smallest = smallest.min(square);
            }
        }
        let smallest = smallest.into_iter().fold(f64::INFINITY, f64::min);
        self.squares.iter().position(|&square| square == smallest).unwrap_or(0)
    }
}

#[inline(always)]
fn squared_distances<S: Simd>(coordinates: &[Vec<f64>; 3], at: Point, squares: &mut [f64]) {
    squares.fill(0.0);
    for (coordinates, at) in coordinates.iter().zip(at) {
        for (square, x) in squares.iter_mut().zip(coordinates) {
            let distance = x - at;
            *square = multiply_add::<S>(distance, distance, *square);
        }
    }
}

/// β += k(y) inᵀ over all centers.
struct Learn<'a, const M: usize> {
    geometry: &'a Geometry,
    nodal_values: &'a mut [Vec<f64>],
    at: Point,
    increment: &'a SVector<f64, M>,
    kernel_vector: &'a mut [f64],
}

impl<const M: usize> VectorLoop for Learn<'_, M> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { geometry, nodal_values, at, increment, kernel_vector } = self;
        squared_distances::<S>(&geometry.coordinates, at, kernel_vector);
        geometry.kernel.radial().replace_squares::<S>(kernel_vector);
        let (kernel, _) = S::as_simd_f64s(kernel_vector);
        for (values, &increment) in nodal_values.iter_mut().zip(increment) {
            let (values, _) = S::as_mut_simd_f64s(values);
            let increment = simd.splat_f64s(increment);
            for (value, &kernel) in values.iter_mut().zip(kernel) {
                *value = simd.mul_add_e_f64s(kernel, increment, *value);
            }
        }
    }
}

/// K_c = R Rᵀ, row after row.
struct Factor<'a> {
    geometry: &'a Geometry,
    neighbourhood: &'a mut Neighbourhood,
}

impl VectorLoop for Factor<'_> {
    type Output = ();

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) {
        let Self { geometry, neighbourhood: Neighbourhood { points, factor, kernel, .. } } = self;
        let n = points.len();
        let row_length = whole_lanes(n);
        let smallest_pivot = n as f64 * f64::EPSILON * geometry.value_at_zero;
        factor.fill(0.0);
        for i in 0..n {
            let kernel = &mut kernel[..=i];
            for (square, point) in kernel.iter_mut().zip(points.iter()) {
                *square = (0..3).map(|axis| (point[axis] - points[i][axis]).powi(2)).sum();
            }
            geometry.kernel.radial().replace_squares::<S>(kernel);
            kernel[i] += geometry.nugget * geometry.value_at_zero;
            let (above, row) = factor.split_at_mut(i * row_length);
            let row = &mut row[..row_length];
            for j in 0..i {
                let other = &above[j * row_length..][..row_length];
                let lanes = whole_lanes(j);
                let known = dot(simd, &row[..lanes], &other[..lanes]);
                row[j] = if other[j] > 0.0 { (kernel[j] - known) / other[j] } else { 0.0 };
            }
            let lanes = whole_lanes(i);
            let square = kernel[i] - dot(simd, &row[..lanes], &row[..lanes]);
            row[i] = if square > smallest_pivot { square.sqrt() } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zero(centers: &Centers, block: usize) -> Result<ScatteredFunction<3>, DesignError> {
        let kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };
        let options = LocalSolver { block: Some(block), ..LocalSolver::default() };
        ScatteredFunction::zero((kernel, &LengthScale::Isotropic(1.0)), centers, 0.0, &options)
    }

    fn sunflower(n: usize) -> Centers {
        let point = |i: usize| {
            let (t, r) = (i as f64 * 2.4, 2.0 * (i as f64 / n as f64).cbrt());
            [r * t.cos(), r * t.sin(), (0.7 * t).sin()]
        };
        Centers::listed((0..n).map(point).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn equal_centers_are_refused_by_name() {
        let mut points: Vec<[f64; 3]> = sunflower(300).points().map(|p| [p[0], p[1], p[2]]).collect();
        points[211] = points[17];
        let error = zero(&Centers::listed(points).unwrap(), 4).unwrap_err().to_string();
        assert!(error.contains("centers 18 and 212 are equal"), "{error}");
    }

    /// Against a search of all: the neighbours of each center, and the center nearest to any point.
    #[test]
    fn the_neighbours_are_the_nearest() {
        let centers = sunflower(200);
        let mut f = zero(&centers, 4).unwrap();
        let points: Vec<Point> = centers.points().map(|p| [p[0], p[1], p[2]]).collect();
        let square = |a: &Point, b: &Point| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>();
        for (j, point) in points.iter().enumerate() {
            let mut expected: Vec<f64> = points.iter().map(|other| square(point, other)).collect();
            expected.sort_by(f64::total_cmp);
            let found: Vec<f64> =
                f.geometry.members(j).iter().map(|&i| square(point, &points[i as usize])).collect();
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "center {j}");
            let beside = [point[0] + 0.01, point[1] - 0.02, point[2] + 0.015];
            let nearest = f.geometry.nearest(beside, &mut f.at_output.squares);
            let smallest = points.iter().map(|p| square(p, &beside)).fold(f64::INFINITY, f64::min);
            assert_eq!(square(&points[nearest], &beside), smallest);
        }
    }

    /// With all centers as neighbours it is the dense solver.
    #[test]
    fn with_all_centers_it_is_exact() {
        let centers = sunflower(40);
        let mut local = zero(&centers, 4).unwrap();
        assert_eq!((local.n_neighbours(), local.predicted_error()), (40, 0.0));
        let kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };
        let space = NativeSpace::new(kernel, &LengthScale::Isotropic(1.0), centers, 0.0).unwrap();
        let mut dense = crate::dense_function::DenseFunction::<3>::zero(space);
        for j in 0..60 {
            let t = j as f64 * 0.3;
            let y = [t.sin(), t.cos(), (2.0 * t).sin()];
            let increment = SVector::from([t.cos(), 1.0, -0.5]);
            dense.hold(&y);
            local.hold(&y);
            let (exact, found) = (dense.held(), local.held());
            assert!((exact.value - found.value).norm() < 1e-9 * (1.0 + exact.value.norm()), "step {j}");
            dense.learn(&increment);
            local.learn(&increment);
        }
        assert!((local.native_norm() / dense.native_norm() - 1.0).abs() < 1e-9);
    }
}
