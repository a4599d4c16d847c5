//! The latency of a velocity sensor, from the accelerometer of the same flight.
//!
//! What a velocity changes between two samples is the specific force in between, turned and with gravity, taken a latency earlier:
//!
//! ```text
//! v_k − v_{k−1} = ∫ (R a + g) dt − ∫ R dt · b + [R (ω × l)]_{k−1}^{k},    from t_{k−1} − τ to t_k − τ
//! ```
//!
//! Linear in the accelerometer's bias b and the lever arm l: for every τ they are solved for, and what remains is compared. No model of
//! the vehicle, and no filter, has a part in it.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// What an instant of the accelerometer adds, accumulated from the beginning.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    /// Since the beginning (s).
    pub(super) t_s: f64,
    /// ∫ (R a + g) dt (m/s).
    pub(super) velocity_m_s: Vector3<f64>,
    /// ∫ R dt (s).
    pub(super) turned_s: Matrix3<f64>,
    /// R [ω]×, whose product with l is the velocity of the sensor's place (1/s).
    pub(super) of_arm_per_s: Matrix3<f64>,
    /// R a + g (m/s²), and R.
    now: (Vector3<f64>, Matrix3<f64>),
}

impl Moment {
    /// The moment of this R a + g (m/s²) and R after another, by the trapezoidal rule.
    pub(super) fn after(
        before: Option<&Self>,
        t_s: f64,
        acceleration_m_s2: &Vector3<f64>,
        turn: &Matrix3<f64>,
        of_arm_per_s: Matrix3<f64>,
    ) -> Self {
        let now = (*acceleration_m_s2, *turn);
        let first =
            Self { t_s, velocity_m_s: Vector3::zeros(), turned_s: Matrix3::zeros(), of_arm_per_s, now };
        before.map_or(first, |before| {
            let half_s = 0.5 * (t_s - before.t_s);
            Self {
                velocity_m_s: before.velocity_m_s + half_s * (before.now.0 + now.0),
                turned_s: before.turned_s + half_s * (before.now.1 + now.1),
                ..first
            }
        })
    }
}

/// A reading: time of its stamp (s), and inertial velocity (m/s).
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub(super) t_s: f64,
    pub(super) velocity_m_s: Vector3<f64>,
}

/// Latencies that are compared (s).
const LARGEST_S: f64 = 0.6;
const STEP_S: f64 = 0.005;
/// Two samples further apart say nothing: a gap (s).
const LONGEST_S: f64 = 1.0;

/// The latency (s) and its deviation; `None` where the flight does not tell it.
pub(super) fn latency_s(moments: &[Moment], readings: &[Reading]) -> Option<(f64, f64)> {
    let costs: Vec<(f64, f64)> = (0..=(LARGEST_S / STEP_S) as usize)
        .filter_map(|k| {
            let latency_s = k as f64 * STEP_S;
            Some((latency_s, cost(moments, readings, latency_s)?))
        })
        .collect();
    let best = (0..costs.len()).min_by(|&a, &b| costs[a].1.total_cmp(&costs[b].1))?;
    // At an end of the range there is no minimum.
    let (Some(before), Some(after)) = (best.checked_sub(1).map(|k| costs[k].1), costs.get(best + 1)) else {
        return (best == 0).then_some((0.0, STEP_S));
    };
    let curvature = before - 2.0 * costs[best].1 + after.1;
    let offset_s = 0.5 * STEP_S * (before - after.1) / curvature;
    // The costs are sums of squares in their own variance.
    let variance = costs[best].1 / (3.0 * readings.len() as f64);
    Some((costs[best].0 + offset_s, (2.0 * variance / curvature).sqrt() * STEP_S))
}

/// Sum of the squares that remain (m²/s²).
fn cost(moments: &[Moment], readings: &[Reading], latency_s: f64) -> Option<f64> {
    let mut normal = SMatrix::<f64, 6, 6>::identity() * 1e-9;
    let mut right = SVector::<f64, 6>::zeros();
    let mut squares = 0.0;
    let mut n = 0;
    for pair in readings.windows(2) {
        let [first, second] = [pair[0], pair[1]];
        if second.t_s - first.t_s > LONGEST_S {
            continue;
        }
        let ends = (at(moments, first.t_s - latency_s), at(moments, second.t_s - latency_s));
        let (Some(from), Some(to)) = ends else { continue };
        let change = second.velocity_m_s - first.velocity_m_s - (to.velocity_m_s - from.velocity_m_s);
        let (of_bias, of_arm) = (from.turned_s - to.turned_s, to.of_arm_per_s - from.of_arm_per_s);
        for axis in 0..3 {
            let row = SVector::<f64, 6>::from_fn(|k, _| match k {
                0..3 => of_bias[(axis, k)],
                k => of_arm[(axis, k - 3)],
            });
            normal += row * row.transpose();
            right += row * change[axis];
            squares += change[axis] * change[axis];
        }
        n += 1;
    }
    let solved = normal.cholesky()?.solve(&right);
    (n >= 30).then(|| squares - right.dot(&solved))
}

/// Between two moments, on a straight line.
fn at(moments: &[Moment], t_s: f64) -> Option<Moment> {
    let after = moments.partition_point(|moment| moment.t_s < t_s);
    let (first, second) = (moments.get(after.checked_sub(1)?)?, moments.get(after)?);
    let part = (t_s - first.t_s) / (second.t_s - first.t_s);
    Some(Moment {
        t_s,
        velocity_m_s: first.velocity_m_s.lerp(&second.velocity_m_s, part),
        turned_s: first.turned_s + part * (second.turned_s - first.turned_s),
        of_arm_per_s: first.of_arm_per_s + part * (second.of_arm_per_s - first.of_arm_per_s),
        now: second.now,
    })
}
