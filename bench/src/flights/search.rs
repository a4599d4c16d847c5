//! The search of `bench tune`.
//!
//! Of the flight's first half, the time after the first 2 s is cut into blocks. The cost is the mean over the blocks of
//!
//! `J = w ln(c / c₀) + (1 − w) ln(s / s₀)`
//!
//! with c the geometric mean of the errors after a coast, s that of the next sample's prediction, and ₀ those of the
//! configuration to start from. Ratios give a fast manoeuvre the same weight as a calm second. The search
//! (Nelder–Mead, from several simplices) runs in the logarithms of λ, Γ, ℓ, the dead zone and the centers' spacing over
//! ℓ. A configuration that the observer refuses as unstable costs more than any other, so only provably stable ones are
//! chosen.
//!
//! The chosen configuration has the least `J + μ ‖q‖²` of all candidates, with q the logarithms of its values over those of
//! the start. The second term prefers configurations near the start. μ is cross-validated over time: the candidate that is
//! chosen on all blocks but one is evaluated on that block, and the highest μ within a standard error of the best one is
//! used (Breiman et al., *Classification and Regression Trees*, 1984, §3.4.3).

use super::accuracy::{Finding, Flight, ObserverEstimator, fly};
use anyhow::{Context, ensure};
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use daemon::assemble;
use daemon::config::{ConfigFile, LengthScaleConfig, SymmetricMatrix, TranslationConfig};
use indicatif::ProgressBar;
use nalgebra::Vector3;
use observer::Learn;
use serde::Serialize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Blocks of the cross-validation.
const N_BLOCKS: usize = 3;
/// The exact solver is used up to this number of centers; no more are tried.
const MAX_CENTERS: usize = 1000;
/// The cost of a candidate that is refused, or lies outside of the bounds. The cost of any other is far lower.
const REFUSED: f64 = 1e3;
/// The values of μ, the price of the distance from the start; with the last one hardly any step pays.
const PRICES: [f64; 9] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
/// Factors on λ, Γ, ℓ, the dead zone and the spacing from which the searches start.
const STARTS: [[f64; 5]; 4] =
    [[1.0; 5], [1.0, 0.1, 1.0, 1.0, 1.0], [2.0, 1.0, 2.0, 0.5, 1.0], [0.5, 0.2, 0.5, 1.0, 1.0]];
/// Errors below this count as this (m/s).
const MIN_ERROR_M_S: f64 = 1e-6;
/// A panic in a search ends the program.
const UNPOISONED: &str = "no search panicked";
/// Edge of the first simplex, as a factor.
const EDGE: f64 = 1.6;

/// The numbers that are searched.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Values {
    pub(super) mass_kg: f64,
    pub(super) gain_per_s: f64,
    pub(super) adaptation_rate_kg_s2: f64,
    pub(super) length_scale_m_s: f64,
    pub(super) dead_zone_width_m_s: f64,
    pub(super) centers_lower_m_s: [f64; 3],
    pub(super) centers_upper_m_s: [f64; 3],
    pub(super) centers_per_axis: [usize; 3],
}

/// A candidate that was tried: its coordinates, and the typical errors of coast and next sample in each block.
struct Tried {
    coordinates: Vec<f64>,
    blocks: Vec<[f64; 2]>,
}

/// Coordinates to configurations to costs.
pub(super) struct Search<'a> {
    start: &'a ConfigFile,
    base: Values,
    /// Distance of the start's centers over its length scale.
    start_spacing: f64,
    flight: &'a Flight,
    coast_weight: f64,
    with_mass: bool,
    reference: Vec<[f64; 2]>,
    tried: Mutex<Vec<Tried>>,
    refused: AtomicUsize,
    bar: &'a ProgressBar,
}

/// The result of a search.
pub(super) struct Chosen {
    pub(super) values: Values,
    pub(super) config: ConfigFile,
    /// μ.
    pub(super) price: f64,
    /// exp J of each block, by the candidate that is chosen on the other blocks; 1 is the start.
    pub(super) cross_validated_ratio: f64,
    pub(super) n_tried: usize,
    pub(super) n_refused: usize,
}

/// The start's own numbers; the box of its centers widened to the velocities flown, with a tenth of their range to spare.
fn values_of(translation: &TranslationConfig, flight: &Flight) -> anyhow::Result<Values> {
    let lattice =
        (translation.centers_lower_m_s, translation.centers_upper_m_s, translation.centers_per_axis);
    let (Some(lower), Some(upper), Some(per_axis)) = lattice else {
        anyhow::bail!("the configuration lists its centers; needed: a lattice (centers_lower_m_s and so on)");
    };
    let (lowest, highest) = (flight.extreme_velocity(f64::min), flight.extreme_velocity(f64::max));
    let room: [f64; 3] = std::array::from_fn(|axis| 0.1 * (highest[axis] - lowest[axis]));
    let not_gradient = "found law = \"joint\"; needed: law = \"gradient\", whose numbers are searched";
    let length_scale_m_s = match translation.length_scale_m_s.as_ref().context(not_gradient)? {
        LengthScaleConfig::Isotropic(scale) => *scale,
        LengthScaleConfig::PerAxis(scales) => scales.iter().sum::<f64>() / scales.len() as f64,
    };
    let adaptation_rate_kg_s2 = match translation.adaptation_rate_kg_s2.context(not_gradient)? {
        SymmetricMatrix::Scalar(rate) => rate,
        SymmetricMatrix::Diagonal(rates) => rates.iter().sum::<f64>() / 3.0,
        SymmetricMatrix::Full(rows) => (rows[0][0] + rows[1][1] + rows[2][2]) / 3.0,
    };
    Ok(Values {
        mass_kg: translation.mass_kg,
        gain_per_s: translation.gain_per_s.context(not_gradient)?,
        adaptation_rate_kg_s2,
        length_scale_m_s,
        dead_zone_width_m_s: translation.dead_zone_width_m_s.context(not_gradient)?,
        centers_lower_m_s: std::array::from_fn(|axis| lower[axis].min(lowest[axis] - room[axis])),
        centers_upper_m_s: std::array::from_fn(|axis| upper[axis].max(highest[axis] + room[axis])),
        centers_per_axis: per_axis,
    })
}

fn spacing_of(values: &Values) -> f64 {
    let edge_m_s = values.centers_upper_m_s[0] - values.centers_lower_m_s[0];
    let n_gaps = values.centers_per_axis[0].saturating_sub(1).max(1) as f64;
    (edge_m_s / n_gaps / values.length_scale_m_s).clamp(0.25, 1.8)
}

impl<'a> Search<'a> {
    /// A search from this configuration, on this flight.
    pub(super) fn new(
        start: &'a ConfigFile,
        flight: &'a Flight,
        coast_weight: f64,
        with_mass: bool,
        bar: &'a ProgressBar,
    ) -> anyhow::Result<Self> {
        let translation = start.config.translation.as_ref();
        let base = values_of(translation.context("the configuration has no [translation]")?, flight)?;
        Ok(Self {
            start,
            base,
            start_spacing: spacing_of(&base),
            flight,
            coast_weight,
            with_mass,
            reference: block_errors(flight, start)?,
            tried: Mutex::default(),
            refused: AtomicUsize::default(),
            bar,
        })
    }

    /// Tries about `n_evaluations` configurations, and chooses one.
    pub(super) fn run(mut self, n_evaluations: u64) -> anyhow::Result<Chosen> {
        self.descend(n_evaluations)?;
        let tried = std::mem::take(self.tried.get_mut().expect(UNPOISONED));
        let (price, cross_validated_cost) = self.price(&tried);
        let chosen = self.best_of(&tried, None, price).context("every configuration was refused")?;
        let values = self.values(&chosen.coordinates).context("the best one is within the bounds")?;
        let n_refused = *self.refused.get_mut();
        Ok(Chosen {
            config: self.config(&values),
            values,
            price,
            cross_validated_ratio: cross_validated_cost.exp(),
            n_tried: tried.len() + n_refused,
            n_refused,
        })
    }

    /// Coordinates: logarithms of the factors on λ, Γ, ℓ and d, of the spacing over ℓ, and of the factor on m.
    fn values(&self, coordinates: &[f64]) -> Option<Values> {
        let factor = |index: usize| coordinates[index].exp();
        let base = &self.base;
        let mass_factor = if self.with_mass { factor(5) } else { 1.0 };
        let length_scale_m_s = base.length_scale_m_s * factor(2);
        let spacing_m_s = length_scale_m_s * factor(4);
        let centers_per_axis: [usize; 3] = std::array::from_fn(|axis| {
            let edge_m_s = base.centers_upper_m_s[axis] - base.centers_lower_m_s[axis];
            // A float becomes the nearest usize, whatever it is.
            ((edge_m_s / spacing_m_s).round() as usize).saturating_add(1).max(2)
        });
        let n_centers = centers_per_axis.iter().fold(1_usize, |n, &each| n.saturating_mul(each));
        let within = coordinates.iter().all(|c| c.abs() < 50_f64.ln())
            && (0.75..=1.25).contains(&mass_factor)
            && (0.2..=2.0).contains(&factor(4))
            && n_centers <= MAX_CENTERS;
        within.then(|| Values {
            mass_kg: base.mass_kg * mass_factor,
            gain_per_s: base.gain_per_s * factor(0),
            adaptation_rate_kg_s2: base.adaptation_rate_kg_s2 * factor(1),
            length_scale_m_s,
            dead_zone_width_m_s: base.dead_zone_width_m_s * factor(3),
            centers_per_axis,
            ..*base
        })
    }

    fn config(&self, values: &Values) -> ConfigFile {
        let mut file = self.start.clone();
        let translation = file.config.translation.as_mut().expect("the start has one");
        let factor = values.dead_zone_width_m_s / self.base.dead_zone_width_m_s;
        translation.dead_zone_buffer_m_s = translation.dead_zone_buffer_m_s.map(|buffer| buffer * factor);
        translation.dead_zone_width_m_s = Some(values.dead_zone_width_m_s);
        translation.mass_kg = values.mass_kg;
        translation.gain_per_s = Some(values.gain_per_s);
        // Axes keep their proportions.
        let factor = values.adaptation_rate_kg_s2 / self.base.adaptation_rate_kg_s2;
        match &mut translation.adaptation_rate_kg_s2 {
            Some(SymmetricMatrix::Scalar(rate)) => *rate *= factor,
            Some(SymmetricMatrix::Diagonal(rates)) => rates.iter_mut().for_each(|rate| *rate *= factor),
            Some(SymmetricMatrix::Full(rows)) => rows.iter_mut().flatten().for_each(|rate| *rate *= factor),
            None => {}
        }
        let factor = values.length_scale_m_s / self.base.length_scale_m_s;
        match &mut translation.length_scale_m_s {
            Some(LengthScaleConfig::Isotropic(scale)) => *scale *= factor,
            Some(LengthScaleConfig::PerAxis(scales)) => scales.iter_mut().for_each(|scale| *scale *= factor),
            None => {}
        }
        translation.centers_lower_m_s = Some(values.centers_lower_m_s);
        translation.centers_upper_m_s = Some(values.centers_upper_m_s);
        translation.centers_per_axis = Some(values.centers_per_axis);
        file
    }

    /// Nelder–Mead from each start, all at once, then once more from the best of all.
    fn descend(&self, n_evaluations: u64) -> anyhow::Result<()> {
        let each = n_evaluations / (STARTS.len() as u64 + 1);
        let corner = |factors: [f64; 5]| {
            let mut corner: Vec<f64> = factors.iter().map(|factor| factor.ln()).collect();
            corner[4] += self.start_spacing.ln();
            corner.extend(self.with_mass.then_some(0.0));
            corner
        };
        std::thread::scope(|scope| {
            let searches =
                STARTS.map(|factors| scope.spawn(move || self.descend_from(corner(factors), each)));
            searches.into_iter().try_for_each(|search| search.join().expect("a search does not panic"))
        })?;
        let best = self
            .best_of(&self.tried.lock().expect(UNPOISONED), None, 0.0)
            .map(|tried| tried.coordinates.clone());
        best.map_or(Ok(()), |best| self.descend_from(best, each))
    }

    fn descend_from(&self, corner: Vec<f64>, n_evaluations: u64) -> anyhow::Result<()> {
        let mut simplex = vec![corner.clone()];
        for axis in 0..corner.len() {
            let edge = if axis == 5 { 1.05_f64.ln() } else { EDGE.ln() };
            let mut point = corner.clone();
            point[axis] += if axis % 2 == 0 { edge } else { -edge };
            simplex.push(point);
        }
        // An iteration of Nelder–Mead costs one or two evaluations, a shrinking more.
        let solver = NelderMead::new(simplex).with_sd_tolerance(1e-4)?;
        let result = Executor::new(Shared(self), solver)
            .configure(|state| state.max_iters(n_evaluations * 2 / 3))
            .run()?;
        ensure!(result.state().get_best_cost().is_finite(), "the search found no finite cost");
        Ok(())
    }

    /// Mean over the blocks, or over all but one.
    fn cost_of(&self, blocks: &[[f64; 2]], without: Option<usize>) -> f64 {
        let kept = (0..blocks.len()).filter(|block| Some(*block) != without);
        let costs: Vec<f64> = kept.map(|block| self.block_cost(blocks, block)).collect();
        costs.iter().sum::<f64>() / costs.len() as f64
    }

    /// J of one block.
    fn block_cost(&self, blocks: &[[f64; 2]], block: usize) -> f64 {
        let ([coast, step], [coast_0, step_0]) = (blocks[block], self.reference[block]);
        self.coast_weight * (coast / coast_0).ln() + (1.0 - self.coast_weight) * (step / step_0).ln()
    }

    fn best_of<'t>(&self, tried: &'t [Tried], without: Option<usize>, price: f64) -> Option<&'t Tried> {
        let cost =
            |tried: &Tried| self.cost_of(&tried.blocks, without) + price * self.distance(&tried.coordinates);
        tried.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// Squared distance from the start, in logarithms.
    fn distance(&self, coordinates: &[f64]) -> f64 {
        let square =
            |(index, c): (usize, &f64)| if index == 4 { c - self.start_spacing.ln() } else { *c }.powi(2);
        coordinates.iter().enumerate().map(square).sum()
    }

    /// The highest price whose cost, on blocks that did not choose, is within a standard error of the least one's
    /// (among candidates that cannot be distinguished, the one nearest to the start); and that cost.
    fn price(&self, tried: &[Tried]) -> (f64, f64) {
        let n_blocks = self.reference.len();
        let judged = PRICES.map(|price| {
            let costs: Vec<f64> = (0..n_blocks)
                .filter_map(|block| {
                    let chosen = self.best_of(tried, Some(block), price)?;
                    Some(self.block_cost(&chosen.blocks, block))
                })
                .collect();
            let mean = costs.iter().sum::<f64>() / costs.len() as f64;
            let variance =
                costs.iter().map(|cost| (cost - mean).powi(2)).sum::<f64>() / (n_blocks - 1) as f64;
            (price, mean, (variance / n_blocks as f64).sqrt())
        });
        let (_, least, error) =
            judged.into_iter().min_by(|(_, a, _), (_, b, _)| a.total_cmp(b)).expect("there are prices");
        let (price, mean, _) = judged
            .into_iter()
            .rfind(|(_, mean, _)| *mean <= least + error)
            .expect("the least one is among them");
        (price, mean)
    }
}

/// The cost function that argmin takes by value.
struct Shared<'a, 'b>(&'a Search<'b>);

impl CostFunction for Shared<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let search = self.0;
        search.bar.inc(1);
        let far = coordinates.iter().map(|c| c.abs()).sum::<f64>();
        let config = search.values(coordinates).map(|values| search.config(&values));
        let blocks = config.and_then(|config| block_errors(search.flight, &config).ok());
        let Some(blocks) = blocks.filter(|blocks| blocks.iter().flatten().all(|e| e.is_finite())) else {
            search.refused.fetch_add(1, Ordering::Relaxed);
            return Ok(REFUSED + far);
        };
        let cost = search.cost_of(&blocks, None);
        let mut tried = search.tried.lock().expect(UNPOISONED);
        tried.push(Tried { coordinates: coordinates.clone(), blocks });
        let best = search.best_of(&tried, None, 0.0).map_or(cost, |best| search.cost_of(&best.blocks, None));
        search.bar.set_message(format!("{:.1} % off the start's errors", 100.0 * (1.0 - best.exp())));
        Ok(cost)
    }
}

/// Typical errors of coast and next sample in each block (m/s).
fn block_errors(flight: &Flight, config: &ConfigFile) -> anyhow::Result<Vec<[f64; 2]>> {
    let mut sums: Vec<[MeanLog; 2]> = (0..N_BLOCKS).map(|_| Default::default()).collect();
    let learned_in = flight.half;
    let length = (flight.samples.len() - learned_in).div_ceil(N_BLOCKS);
    fly(flight, ObserverEstimator(assemble::rigid_body(config)?, Learn::ALL), |index, finding| {
        let Some(after) = index.checked_sub(learned_in) else { return };
        let block = &mut sums[after / length];
        match finding {
            Finding::Coast(_, error) => block[0].add(&error),
            Finding::NextSample(error) => block[1].add(&error),
        }
    })?;
    Ok(sums.iter().map(|[coast, step]| [coast.mean(), step.mean()]).collect())
}

/// Geometric mean of the errors' norms.
#[derive(Default)]
struct MeanLog {
    sum: f64,
    count: usize,
}

impl MeanLog {
    fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm().max(MIN_ERROR_M_S).ln();
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        (self.sum / self.count as f64).exp()
    }
}
