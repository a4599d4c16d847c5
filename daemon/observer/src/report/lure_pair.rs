//! The Lur'e pair of a linear plant's error dynamics: the condition under which the law reduces the error's energy V.

use crate::linear_design::ObservablePart;
use crate::plant::linear_algebra::{complement, eigenvalues, reachable_subspace, spectral_norm};
use nalgebra::DMatrix;

/// The solution of the Lur'e equations (Niu et al., eqs. (Lur'e)): `A_eᵀP + PA_e = −WᵀW − εP`, `PB = Cᵀ`.
#[derive(Debug, Clone, PartialEq)]
pub struct LurePair {
    /// P, symmetric positive definite, n×n.
    pub p: DMatrix<f64>,
    /// W, n×n.
    pub w: DMatrix<f64>,
    /// ε > 0 (1/s).
    pub epsilon: f64,
    /// λ_min(Q), Q = WᵀW + εP.
    pub lambda_min: f64,
    /// ‖PL‖₂.
    pub pl_norm: f64,
    /// ‖P‖₂.
    pub p_norm: f64,
    /// ‖PB − Cᵀ‖, the largest entry.
    pub input_residual: f64,
    /// ‖A_eᵀP + PA_e + WᵀW + εP‖, the largest entry.
    pub lyapunov_residual: f64,
}

impl ObservablePart {
    /// Its Lur'e pair.
    ///
    /// # Errors
    /// A sentence about the condition that fails.
    pub(crate) fn lure_pair(&self) -> Result<LurePair, String> {
        lure_pair(&self.error_dynamics(), &self.b, &self.c, &self.gain)
    }
}

/// A Lur'e pair of the error dynamics `A_e = A − LC`, or why there is none.
///
/// PB = Cᵀ has a solution P ≻ 0 iff CB is symmetric positive definite; then every one is, in the coordinates
/// z = (y, w) = Tx = (Cx, Nᵀx) with NᵀB = 0, `P = diag(S, X)` with S = (CB)⁻¹ and X ≻ 0. With H = T⁻ᵀT⁻¹ and A_e in these
/// coordinates, Q ⪰ μI is by the Schur complement
///
/// ```text
/// N₁₁ := −(A₁₁ᵀS + SA₁₁) − μH₁₁ ≻ 0 ,     FᵀX + XF + XRX + G ⪯ 0 ,
/// R = A₂₁ N₁₁⁻¹ A₂₁ᵀ ,  M = SA₁₂ + μH₁₂ ,  F = A₂₂ + A₂₁ N₁₁⁻¹ M ,  G = MᵀN₁₁⁻¹M + μH₂₂
/// ```
///
/// and has a solution X ≻ 0 iff the Riccati equation has one. μ is scanned from the largest that N₁₁ bears downwards;
/// of the pairs found the one with the least ‖PL‖/λ_min(Q), hence the least E₀, is taken. With C = I, A = 0, B = M⁻¹
/// there is nothing to scan: P = M, Q = PL + LᵀP.
///
/// # Errors
/// A sentence about the condition that fails.
pub(crate) fn lure_pair(
    a_e: &DMatrix<f64>,
    b: &DMatrix<f64>,
    c: &DMatrix<f64>,
    l: &DMatrix<f64>,
) -> Result<LurePair, String> {
    const NO_SYMMETRIC_CB: &str = "CB is not symmetric positive definite, so that no P ≻ 0 has PB = Cᵀ";
    let (n, m) = (a_e.nrows(), b.ncols());
    let cb = c * b;
    if (&cb - cb.transpose()).amax() > 1e-9 * cb.amax() || cb.clone().cholesky().is_none() {
        return Err(NO_SYMMETRIC_CB.into());
    }
    // By LU: for up to four rows `try_inverse` uses cofactors, which lose digits.
    let inverse = |matrix: &DMatrix<f64>| matrix.clone().lu().try_inverse();
    let s = inverse(&cb).ok_or(NO_SYMMETRIC_CB)?;
    let s = 0.5 * (&s + s.transpose());
    let null = complement(&reachable_subspace(&DMatrix::zeros(n, n), b));
    if null.ncols() != n - m {
        return Err("B has not as many independent columns as there are inputs".into());
    }
    let mut t = DMatrix::zeros(n, n);
    t.rows_mut(0, m).copy_from(c);
    t.rows_mut(m, n - m).copy_from(&null.transpose());
    let t_inverse = inverse(&t).ok_or("C and the null space of Bᵀ are not complementary")?;
    let block = |matrix: &DMatrix<f64>, i: usize, j: usize| {
        let (rows, columns) = ([m, n - m][i], [m, n - m][j]);
        matrix.view(([0, m][i], [0, m][j]), (rows, columns)).into_owned()
    };
    let dynamics = &t * a_e * &t_inverse;
    let (a11, a12) = (block(&dynamics, 0, 0), block(&dynamics, 0, 1));
    let (a21, a22) = (block(&dynamics, 1, 0), block(&dynamics, 1, 1));
    let h = t_inverse.transpose() * &t_inverse;
    let (h11, h12, h22) = (block(&h, 0, 0), block(&h, 0, 1), block(&h, 1, 1));
    let q11 = -(a11.transpose() * &s + &s * &a11);
    let q11 = 0.5 * (&q11 + q11.transpose());
    let Some(factor) = q11.clone().cholesky() else {
        return Err(
            "the output error does not decay by itself: −(A₁₁ᵀ(CB)⁻¹ + (CB)⁻¹A₁₁) is not positive definite; \
             raise L along B"
                .into(),
        );
    };
    let with_x = |x: &DMatrix<f64>| {
        let mut diagonal = DMatrix::zeros(n, n);
        diagonal.view_mut((0, 0), (m, m)).copy_from(&s);
        diagonal.view_mut((m, m), (n - m, n - m)).copy_from(x);
        let p = t.transpose() * diagonal * &t;
        finish(a_e, b, c, l, 0.5 * (&p + p.transpose()))
    };
    if n == m {
        return with_x(&DMatrix::zeros(0, 0)).ok_or_else(|| "A_eᵀP + PA_e is not negative definite".into());
    }
    // The largest μ with Q₁₁ − μH₁₁ ⪰ 0 is 1/λ_max(Q₁₁⁻¹H₁₁).
    let largest = 1.0 / eigenvalues(&factor.solve(&h11)).iter().map(|x| x.re).fold(0.0, f64::max);
    let pair_at = |mu: f64| {
        let n11 = (&q11 - mu * &h11).cholesky()?;
        let to_output = &s * &a12 + mu * &h12;
        let r = &a21 * n11.solve(&a21.transpose());
        let f = &a22 + &a21 * n11.solve(&to_output);
        let g = to_output.transpose() * n11.solve(&to_output) + mu * &h22;
        with_x(&riccati(&f, &r, &g)?).map(|pair| (mu, pair))
    };
    let least = |candidates: Vec<f64>| {
        let pairs = candidates.into_iter().filter_map(pair_at);
        pairs.min_by(|(_, a), (_, b)| (a.pl_norm / a.lambda_min).total_cmp(&(b.pl_norm / b.lambda_min)))
    };
    let coarse = (1..=80).map(|step| largest * 10.0_f64.powf(-f64::from(step) / 6.0)).collect();
    least(coarse)
        .and_then(|(mu, _)| {
            least((-12..=12).map(|step| mu * 10.0_f64.powf(f64::from(step) / 60.0)).collect())
        })
        .map(|(_, pair)| pair)
        .ok_or_else(|| {
            "the error dynamics are not strictly positive real from B to C: no P ≻ 0 that satisfies both \
             equations was found"
                .into()
        })
}

fn finish(
    a_e: &DMatrix<f64>,
    b: &DMatrix<f64>,
    c: &DMatrix<f64>,
    l: &DMatrix<f64>,
    p: DMatrix<f64>,
) -> Option<LurePair> {
    let q = -(a_e.transpose() * &p + &p * a_e);
    let q = 0.5 * (&q + q.transpose());
    let lambda_min = q.clone().symmetric_eigenvalues().min();
    if p.clone().cholesky().is_none() || lambda_min <= 0.0 {
        return None;
    }
    // Half of the largest ε with Q − εP ⪰ 0, which is 1/λ_max(Q⁻¹P).
    let factor = q.clone().cholesky()?.l();
    let whitened = factor.solve_lower_triangular(&p)?;
    let whitened = factor.solve_lower_triangular(&whitened.transpose())?;
    let epsilon = 0.5 / whitened.symmetric_eigenvalues().max();
    let w = (&q - epsilon * &p).cholesky()?.l().transpose();
    Some(LurePair {
        lambda_min,
        pl_norm: spectral_norm(&(&p * l)),
        p_norm: spectral_norm(&p),
        input_residual: (&p * b - c.transpose()).amax(),
        lyapunov_residual: (a_e.transpose() * &p + &p * a_e + w.transpose() * &w + epsilon * &p).amax(),
        p,
        w,
        epsilon,
    })
}

/// The solution X of FᵀX + XF + XRX + G = 0 for which F + RX is Hurwitz, if it exists and is positive definite: from
/// the matrix sign of the Hamiltonian [[F, R], [−G, −Fᵀ]] (Roberts 1980).
fn riccati(f: &DMatrix<f64>, r: &DMatrix<f64>, g: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = f.nrows();
    let mut sign = DMatrix::zeros(2 * n, 2 * n);
    sign.view_mut((0, 0), (n, n)).copy_from(f);
    sign.view_mut((0, n), (n, n)).copy_from(r);
    sign.view_mut((n, 0), (n, n)).copy_from(&-g);
    sign.view_mut((n, n), (n, n)).copy_from(&-f.transpose());
    let mut settled = false;
    for _ in 0..100 {
        let inverse = sign.clone().lu().try_inverse()?;
        let scale = (inverse.norm() / sign.norm()).sqrt();
        let next = 0.5 * (scale * &sign + inverse / scale);
        let change = (&next - &sign).norm();
        sign = next;
        if settled {
            break;
        }
        settled = change <= 1e-10 * sign.norm();
    }
    if !settled {
        return None;
    }
    let mut left = DMatrix::zeros(2 * n, n);
    let mut right = DMatrix::zeros(2 * n, n);
    let identity = DMatrix::<f64>::identity(n, n);
    left.rows_mut(0, n).copy_from(&sign.view((0, n), (n, n)));
    left.rows_mut(n, n).copy_from(&(sign.view((n, n), (n, n)) + &identity));
    right.rows_mut(0, n).copy_from(&-(sign.view((0, 0), (n, n)) + &identity));
    right.rows_mut(n, n).copy_from(&-sign.view((n, 0), (n, n)));
    let x = left.svd(true, true).solve(&right, 1e-12).ok()?;
    let x = 0.5 * (&x + x.transpose());
    x.clone().cholesky().map(|_| x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::{Random, matrix};
    use nalgebra::DVector;

    /// A channel of the rigid body: P = M and Q = PL + LᵀP.
    #[test]
    fn the_closed_form_of_a_channel() {
        let mass = matrix(3, &[4.0, 0.5, 0.0, 0.5, 3.0, 0.2, 0.0, 0.2, 5.0]);
        let identity = DMatrix::<f64>::identity(3, 3);
        let gain = 10.0 * &identity;
        let pair = lure_pair(&-&gain, &mass.clone().try_inverse().unwrap(), &identity, &gain).unwrap();
        assert!((&pair.p - &mass).amax() < 1e-12);
        let masses = mass.symmetric_eigenvalues();
        assert!((pair.lambda_min - 20.0 * masses.min()).abs() < 1e-10);
        assert!((pair.pl_norm - 10.0 * masses.max()).abs() < 1e-10);
        assert!(pair.input_residual < 1e-12 && pair.lyapunov_residual < 1e-11);
    }

    /// (s + a)/((s + b)(s + c)) is strictly positive real iff a < b + c; C (sI − A_e)⁻¹ B in controller form.
    #[test]
    fn a_pair_exists_just_where_the_transfer_function_is_strictly_positive_real() {
        let (b_pole, c_pole) = (2.0, 3.0);
        let no_gain = matrix(2, &[0.0, 0.0]);
        for (zero, positive_real) in
            [(0.1, true), (1.0, true), (4.0, true), (4.9, true), (5.1, false), (20.0, false), (-0.1, false)]
        {
            let a_e = matrix(2, &[0.0, 1.0, -b_pole * c_pole, -(b_pole + c_pole)]);
            let (b, c) = (matrix(2, &[0.0, 1.0]), matrix(1, &[zero, 1.0]));
            let found = lure_pair(&a_e, &b, &c, &no_gain);
            assert_eq!(found.is_ok(), positive_real, "zero at −{zero}: {found:?}");
            if let Ok(pair) = found {
                let size = pair.p.amax();
                assert!(pair.p.clone().cholesky().is_some() && pair.lambda_min > 0.0);
                assert!(
                    pair.input_residual < 1e-9 * size && pair.lyapunov_residual < 1e-9 * size,
                    "{pair:?}"
                );
            }
        }
    }

    #[test]
    fn without_relative_degree_one_there_is_no_pair() {
        let a_e = matrix(2, &[0.0, 1.0, -6.0, -5.0]);
        let found =
            lure_pair(&a_e, &matrix(2, &[0.0, 1.0]), &matrix(1, &[1.0, 0.0]), &matrix(2, &[0.0, 0.0]));
        assert!(found.unwrap_err().contains("CB"));
    }

    /// Plants made from a P and a Q that are known, so that a pair exists: `A_e = P⁻¹(K − Q/2)`, K skew, C = BᵀP. One is
    /// found for all, with an E₀ that is not much larger, and it solves both equations.
    #[test]
    fn a_pair_is_found_for_every_plant_that_is_made_from_one() {
        let mut random = Random(7);
        let (mut n_found, mut worst) = (0, 0.0_f64);
        for trial in 0..300 {
            let n = 1 + trial % 12;
            let m = 1 + trial % n.min(3);
            let p = random.positive(n, 0.05);
            let q = random.positive(n, 0.01);
            let skew = random.matrix(n, n);
            let skew = &skew - skew.transpose();
            let a_e = p.clone().lu().solve(&(skew - 0.5 * &q)).unwrap();
            let b = random.matrix(n, m);
            if b.singular_values().min() < 0.05 {
                continue;
            }
            let c = b.transpose() * &p;
            let l = random.matrix(n, m);
            let pair = lure_pair(&a_e, &b, &c, &l)
                .unwrap_or_else(|why| panic!("trial {trial}, n {n}, m {m}: {why}"));
            let scale = pair.p.amax() * (1.0 + a_e.amax());
            assert!(
                pair.input_residual < 1e-8 * scale && pair.lyapunov_residual < 1e-8 * scale,
                "{trial}: {pair:?}"
            );
            assert!(pair.lambda_min > 0.0);
            let known = spectral_norm(&(&p * &l)) / q.symmetric_eigenvalues().min();
            worst = worst.max(pair.pl_norm / pair.lambda_min / known);
            n_found += 1;
        }
        println!("{n_found} pairs, E₀ at most {worst:.2} times that of the known one");
        assert!(n_found > 200 && worst < 3.0, "{n_found} {worst}");
    }

    /// Other units of the states, x → Dx, and of the input leave the plant what it is.
    #[test]
    fn a_pair_is_found_in_any_units() {
        let (a_e, b, c) =
            (matrix(2, &[0.0, 1.0, -6.0, -5.0]), matrix(2, &[0.0, 1.0]), matrix(1, &[1.0, 1.0]));
        for (unit, input_unit) in [(1.0, 1.0), (1e-6, 1.0), (1e6, 1.0), (1.0, 1e9), (1e-3, 1e-9)] {
            let d = DMatrix::from_diagonal(&DVector::from_vec(vec![unit, 1.0]));
            let inverse = d.clone().try_inverse().unwrap();
            let (a_e, b, c) = (&d * &a_e * &inverse, &d * &b * input_unit, &c * &inverse / input_unit);
            let found = lure_pair(&a_e, &b, &c, &(&d * matrix(2, &[1.0, 1.0])));
            assert!(found.is_ok(), "{unit} {input_unit}: {found:?}");
        }
    }
}
