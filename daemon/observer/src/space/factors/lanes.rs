//! The loops in which a step spends its time, in lanes of eight. Each is compiled for several vector units (AVX-512, AVX2
//! with FMA, NEON, the baseline); the one for this machine is chosen once at start.
//!
//! The code is plain Rust over arrays of eight, which `pulp` compiles several times. On one kind of vector unit sums have a
//! fixed order, so the same samples give the same bits.

use pulp::{Arch, Simd, WithSimd};

/// Numbers that are processed together: one register of AVX-512, two of AVX2, four of NEON or SSE2.
pub(crate) const LANES: usize = 8;

/// Eight numbers on a cache line of their own.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Lanes(pub(crate) [f64; LANES]);

/// `n` rounded up to whole lanes.
pub(crate) fn whole_lanes(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

/// A loop that is compiled for each vector unit.
pub(crate) trait VectorLoop {
    type Output;

    fn call<S: Simd>(self, simd: S) -> Self::Output;
}

struct WithUnit<L>(L);

impl<L: VectorLoop> WithSimd for WithUnit<L> {
    type Output = L::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> L::Output {
        self.0.call(simd)
    }
}

/// The vector unit that steps run on, in words.
pub fn vector_unit() -> &'static str {
    VectorUnit::of_this_machine().name()
}

/// The vector unit of this machine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VectorUnit(Arch);

impl PartialEq for VectorUnit {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl VectorUnit {
    /// The best one that this machine has.
    pub(crate) fn of_this_machine() -> Self {
        Self(Arch::new())
    }

    /// The baseline that every machine of this kind has, for comparison.
    #[cfg(test)]
    pub(crate) fn baseline() -> Self {
        Self(Arch::Scalar)
    }

    #[inline(always)]
    pub(crate) fn run<L: VectorLoop>(self, vector_loop: L) -> L::Output {
        self.0.dispatch(WithUnit(vector_loop))
    }

    /// A loop without sums, as the compiler makes it for this unit.
    #[inline(always)]
    pub(crate) fn compile<R>(self, plain_loop: impl FnOnce() -> R) -> R {
        self.0.dispatch(plain_loop)
    }

    /// xᵀy of each x; all of whole lanes.
    pub(crate) fn dots<const M: usize>(self, x: [&[f64]; M], y: &[f64]) -> [f64; M] {
        self.run(Dots { x, y })
    }

    /// a·b + c, to the bit as [`multiply_add`] has it on this unit.
    pub(crate) fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        match self.0 {
            Arch::Scalar => a * b + c,
            _ => a.mul_add(b, c),
        }
    }

    /// Its name, for benches.
    fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Arch::V3(_) => "AVX2 with FMA",
            #[cfg(target_arch = "aarch64")]
            Arch::Neon(_) => "NEON",
            _ => "baseline",
        }
    }
}

/// a·b + c, in one instruction where there is one.
#[inline(always)]
pub(crate) fn multiply_add<S: Simd>(a: f64, b: f64, c: f64) -> f64 {
    if S::IS_SCALAR { a * b + c } else { a.mul_add(b, c) }
}

/// xᵀy; both of whole lanes.
#[inline(always)]
pub(crate) fn dot<S: Simd>(simd: S, x: &[f64], y: &[f64]) -> f64 {
    let ((x, _), (y, _)) = (S::as_simd_f64s(x), S::as_simd_f64s(y));
    let mut sum = simd.splat_f64s(0.0);
    for (&x, &y) in x.iter().zip(y) {
        sum = simd.mul_add_e_f64s(x, y, sum);
    }
    simd.reduce_sum_f64s(sum)
}

struct Dots<'a, const M: usize> {
    x: [&'a [f64]; M],
    y: &'a [f64],
}

impl<const M: usize> VectorLoop for Dots<'_, M> {
    type Output = [f64; M];

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> [f64; M] {
        self.x.map(|x| dot(simd, x, self.y))
    }
}

/// e^{−r} for r ≥ 0, within 2 units in the last place; where that is below the smallest normal number, about that.
///
/// `e^{−r} = 2ⁿ e^s`, n the integer nearest to −r/ln 2, |s| ≤ ln 2 / 2, e^s by its series up to s¹³/13! (the next term is
/// below 4·10⁻¹⁸). −r/ln 2 + 1.5·2⁵² has n in its lowest bits, from where it is shifted into the exponent.
#[inline(always)]
pub(crate) fn exp_of_minus<S: Simd>(r: f64) -> f64 {
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    // ln 2 in two parts; the first has so few bits that its product with n is exact.
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    const INVERSE_FACTORIALS: [f64; 13] = [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let x = -r.min(708.0);
    let shifted = multiply_add::<S>(x, std::f64::consts::LOG2_E, SHIFT);
    let n = shifted - SHIFT;
    let s = multiply_add::<S>(n, -LN_2_LOW, multiply_add::<S>(n, -LN_2_HIGH, x));
    let mut series = 1.0 / 6_227_020_800.0;
    for coefficient in INVERSE_FACTORIALS {
        series = multiply_add::<S>(series, s, coefficient);
    }
    f64::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 52))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Exps<'a>(&'a mut [f64]);

    impl VectorLoop for Exps<'_> {
        type Output = ();

        #[inline(always)]
        fn call<S: Simd>(self, _: S) {
            self.0.iter_mut().for_each(|r| *r = exp_of_minus::<S>(*r));
        }
    }

    #[test]
    fn the_exponential_is_right_to_two_units_in_the_last_place() {
        for unit in [VectorUnit::of_this_machine(), VectorUnit::baseline()] {
            let arguments: Vec<f64> = (0..400_000)
                .map(|i| i as f64 * 1.77e-3)
                .chain([0.0, 1e-300, 1e-17, 1e-8, 0.346_573_590_279])
                .collect();
            let mut found = arguments.clone();
            unit.run(Exps(&mut found));
            for (r, found) in arguments.iter().zip(found) {
                let expected = (-r).exp();
                assert!(
                    (found - expected).abs() <= 2.0 * f64::EPSILON * expected,
                    "{r}: {found:e} {expected:e}"
                );
            }
        }
        let mut far = [709.0, 1e4, 1e300, f64::INFINITY];
        VectorUnit::of_this_machine().run(Exps(&mut far));
        assert!(far.iter().all(|&value| (0.0..1e-307).contains(&value)), "{far:?}");
    }

    #[test]
    fn a_dot_product_has_every_term() {
        for n in [8, 16, 24, 80] {
            let (x, y): (Vec<f64>, Vec<f64>) = (0..n).map(|i| (i as f64, (n - i) as f64)).unzip();
            let expected: f64 = x.iter().zip(&y).map(|(x, y)| x * y).sum();
            for unit in [VectorUnit::of_this_machine(), VectorUnit::baseline()] {
                assert_eq!(unit.dots([&x, &y], &y)[0], expected);
            }
        }
    }
}
