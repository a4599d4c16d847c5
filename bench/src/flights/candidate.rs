//! The numbers that `bench tune` searches, of each law: where a search starts, how coordinates move them, and the
//! configuration that has them.
//!
//! Coordinates are the logarithms of factors on the start's numbers; the last one, of the mass, only where it is searched.

use super::accuracy::Flight;
use anyhow::Context;
use daemon::config::{
    AxisValues, ConfigFile, LawName, LengthScaleConfig, SymmetricMatrix, TranslationConfig,
};
use serde::Serialize;

/// The coordinates without that of the mass.
pub(super) const N_NUMBERS: usize = 5;
/// The exact solver is used up to this number of centers; no more are tried.
const MAX_CENTERS: usize = 1000;
/// No number moves by more than this factor, the mass by a quarter.
const MAX_FACTOR: f64 = 50.0;
/// The box of the velocities flown has this part of their range to spare.
const ROOM: f64 = 0.1;

/// Of the law `gradient`: coordinates of λ, Γ, ℓ, the dead zone, and the centers' spacing over ℓ, which is no factor.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct GradientNumbers {
    mass_kg: f64,
    gain_per_s: f64,
    adaptation_rate_kg_s2: f64,
    length_scale_m_s: f64,
    dead_zone_width_m_s: f64,
    centers_lower_m_s: [f64; 3],
    centers_upper_m_s: [f64; 3],
    centers_per_axis: [usize; 3],
}

/// Of the law `joint`: coordinates of the sensor's noise, the box, the lags, the disturbance, and the memory.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct JointNumbers {
    mass_kg: f64,
    velocity_noise_m_s: [f64; 3],
    speed_box_m_s: [f64; 3],
    lag_times_s: [f64; 2],
    disturbance_std_m_s2: f64,
    motion_memory_s: f64,
}

/// The numbers of one configuration.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(untagged)]
pub(super) enum Numbers {
    Gradient(GradientNumbers),
    Joint(JointNumbers),
}

impl Numbers {
    /// The start's own, its box widened to the velocities flown.
    pub(super) fn of(translation: &TranslationConfig, flight: &Flight) -> anyhow::Result<Self> {
        let extremes = [f64::min, f64::max].map(|extreme| flight.extreme_velocity(extreme));
        match translation.law {
            LawName::Gradient => GradientNumbers::of(translation, extremes).map(Self::Gradient),
            LawName::Joint => JointNumbers::of(translation, extremes).map(Self::Joint),
        }
    }

    /// The coordinates of the start.
    pub(super) fn origin(&self) -> [f64; N_NUMBERS] {
        match self {
            Self::Gradient(numbers) => [0.0, 0.0, 0.0, 0.0, numbers.spacing().ln()],
            Self::Joint(_) => [0.0; N_NUMBERS],
        }
    }

    /// Factors from which searches begin.
    pub(super) fn starts(&self) -> [[f64; N_NUMBERS]; 4] {
        match self {
            Self::Gradient(_) => [
                [1.0; N_NUMBERS],
                [1.0, 0.1, 1.0, 1.0, 1.0],
                [2.0, 1.0, 2.0, 0.5, 1.0],
                [0.5, 0.2, 0.5, 1.0, 1.0],
            ],
            Self::Joint(_) => [
                [1.0; N_NUMBERS],
                [3.0, 1.0, 1.0, 1.0, 1.0],
                [0.3, 1.5, 2.0, 1.0, 3.0],
                [1.0, 1.0, 0.5, 5.0, 0.3],
            ],
        }
    }

    /// The numbers at these coordinates; `None` beyond the bounds.
    pub(super) fn at(&self, coordinates: &[f64]) -> Option<Self> {
        let mass_factor = coordinates.get(N_NUMBERS).map_or(1.0, |c| c.exp());
        let is_within = coordinates.iter().all(|c| c.abs() < MAX_FACTOR.ln());
        if !is_within || !(0.75..=1.25).contains(&mass_factor) {
            return None;
        }
        let factors: [f64; N_NUMBERS] = std::array::from_fn(|index| coordinates[index].exp());
        match self {
            Self::Gradient(numbers) => numbers.at(factors, mass_factor).map(Self::Gradient),
            Self::Joint(numbers) => numbers.at(factors, mass_factor).map(Self::Joint),
        }
    }

    /// The configuration `start`, whose numbers are `self`, with these numbers.
    pub(super) fn config(&self, numbers: &Self, start: &ConfigFile) -> ConfigFile {
        let mut file = start.clone();
        let translation = file.config.translation.as_mut().expect("the start has one");
        match (self, numbers) {
            (Self::Gradient(base), Self::Gradient(numbers)) => numbers.write(base, translation),
            (_, Self::Joint(numbers)) => numbers.write(translation),
            (Self::Joint(_), Self::Gradient(_)) => unreachable!("a search keeps its law"),
        }
        file
    }

    /// In words, for people.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Gradient(numbers) => {
                let GradientNumbers { centers_lower_m_s: lower, centers_upper_m_s: upper, .. } = numbers;
                let n = numbers.centers_per_axis;
                format!(
                    "mass {:.3} kg, gain {:.3} 1/s, adaptation rate {:.3} kg/s², length scale {:.3} m/s, dead zone {:.4} m/s,\n\
                     centers {} × {} × {} from {lower:.2?} to {upper:.2?} m/s",
                    numbers.mass_kg,
                    numbers.gain_per_s,
                    numbers.adaptation_rate_kg_s2,
                    numbers.length_scale_m_s,
                    numbers.dead_zone_width_m_s,
                    n[0],
                    n[1],
                    n[2],
                )
            }
            Self::Joint(numbers) => format!(
                "mass {:.3} kg, velocity noise {:.4?} m/s, speed box {:.2?} m/s,\n\
                 lags {:.3?} s, disturbance {:.3} m/s², memory of the motion {:.0} s",
                numbers.mass_kg,
                numbers.velocity_noise_m_s,
                numbers.speed_box_m_s,
                numbers.lag_times_s,
                numbers.disturbance_std_m_s2,
                numbers.motion_memory_s,
            ),
        }
    }
}

impl GradientNumbers {
    fn of(translation: &TranslationConfig, [lowest, highest]: [[f64; 3]; 2]) -> anyhow::Result<Self> {
        let lattice =
            (translation.centers_lower_m_s, translation.centers_upper_m_s, translation.centers_per_axis);
        let (Some(lower), Some(upper), Some(centers_per_axis)) = lattice else {
            anyhow::bail!(
                "the configuration lists its centers; needed: a lattice (centers_lower_m_s and so on)"
            );
        };
        let room: [f64; 3] = std::array::from_fn(|axis| ROOM * (highest[axis] - lowest[axis]));
        let length_scale_m_s = match required(translation.length_scale_m_s.as_ref(), "length_scale_m_s")? {
            LengthScaleConfig::Isotropic(scale) => *scale,
            LengthScaleConfig::PerAxis(scales) => scales.iter().sum::<f64>() / scales.len() as f64,
        };
        let adaptation_rate_kg_s2 =
            match required(translation.adaptation_rate_kg_s2, "adaptation_rate_kg_s2")? {
                SymmetricMatrix::Scalar(rate) => rate,
                SymmetricMatrix::Diagonal(rates) => rates.iter().sum::<f64>() / 3.0,
                SymmetricMatrix::Full(rows) => (rows[0][0] + rows[1][1] + rows[2][2]) / 3.0,
            };
        Ok(Self {
            mass_kg: translation.mass_kg,
            gain_per_s: required(translation.gain_per_s, "gain_per_s")?,
            adaptation_rate_kg_s2,
            length_scale_m_s,
            dead_zone_width_m_s: required(translation.dead_zone_width_m_s, "dead_zone_width_m_s")?,
            centers_lower_m_s: std::array::from_fn(|axis| lower[axis].min(lowest[axis] - room[axis])),
            centers_upper_m_s: std::array::from_fn(|axis| upper[axis].max(highest[axis] + room[axis])),
            centers_per_axis,
        })
    }

    /// Distance of the centers over the length scale.
    fn spacing(&self) -> f64 {
        let edge_m_s = self.centers_upper_m_s[0] - self.centers_lower_m_s[0];
        let n_gaps = self.centers_per_axis[0].saturating_sub(1).max(1) as f64;
        (edge_m_s / n_gaps / self.length_scale_m_s).clamp(0.25, 1.8)
    }

    fn at(&self, factors: [f64; N_NUMBERS], mass_factor: f64) -> Option<Self> {
        let [gain, rate, length_scale, dead_zone, spacing] = factors;
        let length_scale_m_s = self.length_scale_m_s * length_scale;
        let centers_per_axis: [usize; 3] = std::array::from_fn(|axis| {
            let edge_m_s = self.centers_upper_m_s[axis] - self.centers_lower_m_s[axis];
            // A float becomes the nearest usize, whatever it is.
            ((edge_m_s / (length_scale_m_s * spacing)).round() as usize).saturating_add(1).max(2)
        });
        let n_centers = centers_per_axis.iter().fold(1_usize, |n, &each| n.saturating_mul(each));
        ((0.2..=2.0).contains(&spacing) && n_centers <= MAX_CENTERS).then_some(Self {
            mass_kg: self.mass_kg * mass_factor,
            gain_per_s: self.gain_per_s * gain,
            adaptation_rate_kg_s2: self.adaptation_rate_kg_s2 * rate,
            length_scale_m_s,
            dead_zone_width_m_s: self.dead_zone_width_m_s * dead_zone,
            centers_per_axis,
            ..*self
        })
    }

    fn write(&self, base: &Self, translation: &mut TranslationConfig) {
        let factor = self.dead_zone_width_m_s / base.dead_zone_width_m_s;
        translation.dead_zone_buffer_m_s = translation.dead_zone_buffer_m_s.map(|buffer| buffer * factor);
        translation.dead_zone_width_m_s = Some(self.dead_zone_width_m_s);
        translation.mass_kg = self.mass_kg;
        translation.gain_per_s = Some(self.gain_per_s);
        // Axes keep their proportions.
        let factor = self.adaptation_rate_kg_s2 / base.adaptation_rate_kg_s2;
        match &mut translation.adaptation_rate_kg_s2 {
            Some(SymmetricMatrix::Scalar(rate)) => *rate *= factor,
            Some(SymmetricMatrix::Diagonal(rates)) => rates.iter_mut().for_each(|rate| *rate *= factor),
            Some(SymmetricMatrix::Full(rows)) => rows.iter_mut().flatten().for_each(|rate| *rate *= factor),
            None => {}
        }
        let factor = self.length_scale_m_s / base.length_scale_m_s;
        match &mut translation.length_scale_m_s {
            Some(LengthScaleConfig::Isotropic(scale)) => *scale *= factor,
            Some(LengthScaleConfig::PerAxis(scales)) => scales.iter_mut().for_each(|scale| *scale *= factor),
            None => {}
        }
        translation.centers_lower_m_s = Some(self.centers_lower_m_s);
        translation.centers_upper_m_s = Some(self.centers_upper_m_s);
        translation.centers_per_axis = Some(self.centers_per_axis);
    }
}

impl JointNumbers {
    fn of(translation: &TranslationConfig, [lowest, highest]: [[f64; 3]; 2]) -> anyhow::Result<Self> {
        let speed_box: [f64; 3] = required(translation.speed_box_m_s, "speed_box_m_s")?.into();
        let flown = |axis: usize| (1.0 + ROOM) * highest[axis].abs().max(lowest[axis].abs());
        Ok(Self {
            mass_kg: translation.mass_kg,
            velocity_noise_m_s: required(translation.velocity_noise_m_s, "velocity_noise_m_s")?.into(),
            speed_box_m_s: std::array::from_fn(|axis| speed_box[axis].max(flown(axis))),
            lag_times_s: translation.joint.lag_times_s,
            disturbance_std_m_s2: translation.joint.disturbance_std_m_s2,
            motion_memory_s: translation.joint.motion_memory_s,
        })
    }

    /// The box holds the velocities flown: it is not made smaller.
    fn at(&self, factors: [f64; N_NUMBERS], mass_factor: f64) -> Option<Self> {
        let [noise, speed_box, lags, disturbance, memory] = factors;
        (1.0..=5.0).contains(&speed_box).then_some(Self {
            mass_kg: self.mass_kg * mass_factor,
            velocity_noise_m_s: self.velocity_noise_m_s.map(|each| each * noise),
            speed_box_m_s: self.speed_box_m_s.map(|each| each * speed_box),
            lag_times_s: self.lag_times_s.map(|each| each * lags),
            disturbance_std_m_s2: self.disturbance_std_m_s2 * disturbance,
            motion_memory_s: self.motion_memory_s * memory,
        })
    }

    fn write(&self, translation: &mut TranslationConfig) {
        translation.mass_kg = self.mass_kg;
        translation.velocity_noise_m_s = Some(per_axis(self.velocity_noise_m_s));
        translation.speed_box_m_s = Some(per_axis(self.speed_box_m_s));
        translation.joint.lag_times_s = self.lag_times_s;
        translation.joint.disturbance_std_m_s2 = self.disturbance_std_m_s2;
        translation.joint.motion_memory_s = self.motion_memory_s;
    }
}

fn per_axis(values: [f64; 3]) -> AxisValues {
    if values.iter().all(|value| *value == values[0]) {
        AxisValues::All(values[0])
    } else {
        AxisValues::Each(values)
    }
}

fn required<T>(value: Option<T>, key: &str) -> anyhow::Result<T> {
    value.with_context(|| format!("found no translation.{key}, which the law needs"))
}
