//! Noise of a fixed seed, where the simulator's own does not fit.

/// A linear congruential sequence, from its seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Normal to the fourth moment: the sum of twelve uniform numbers.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// Even, 0 … 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}
