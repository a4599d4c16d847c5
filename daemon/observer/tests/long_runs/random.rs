//! Random numbers, the same in every run.

use nalgebra::Vector3;

/// SplitMix64 (Steele, Lea, Flood 2014); streams of different seeds are independent.
#[derive(Debug, Clone)]
pub(crate) struct Random {
    state: u64,
    /// The second number of a Box–Muller pair.
    spare: Option<f64>,
}

impl Random {
    /// One stream of a seed: plant, sensor and pilot draw from streams of their own.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut seeding = Self { state: seed ^ stream.wrapping_mul(0xD134_2543_DE82_EF95), spare: None };
        Self { state: seeding.bits(), spare: None }
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in (0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Normal, of deviation 1.
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        self.spare = Some(radius * sine);
        radius * cosine
    }

    pub(crate) fn normals(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }
}
