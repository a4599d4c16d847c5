//! The search of `bench tune`.
//!
//! Of the flight's first half, the time after the first 2 s is cut into blocks. The cost is the mean over the blocks of
//!
//! `J = w ln(c / c₀) + (1 − w) ln(s / s₀)`
//!
//! with c the geometric mean of the errors after a coast, s that of the next sample's prediction, and ₀ those of the
//! configuration to start from. Ratios give a fast manoeuvre the same weight as a calm second. The search
//! (Nelder–Mead, from several simplices) runs in the logarithms of the few numbers of the law that matter (`candidate`). A
//! configuration that the observer refuses, as unstable say, costs more than any other, so only accepted ones are chosen.
//!
//! The chosen configuration has the least `J + μ ‖q‖²` of all candidates, with q the logarithms of its values over those of
//! the start. The second term prefers configurations near the start. μ is cross-validated over time: the candidate that is
//! chosen on all blocks but one is evaluated on that block, and the highest μ within a standard error of the best one is
//! used (Breiman et al., *Classification and Regression Trees*, 1984, §3.4.3).

use super::accuracy::{Finding, Flight, ObserverEstimator, fly};
use super::candidate::{N_NUMBERS, Numbers};
use anyhow::{Context, ensure};
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use daemon::assemble;
use daemon::config::ConfigFile;
use indicatif::ProgressBar;
use nalgebra::Vector3;
use observer::Learn;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Blocks of the cross-validation.
const N_BLOCKS: usize = 3;
/// The cost of a candidate that is refused, or lies outside of the bounds. The cost of any other is far lower.
const REFUSED: f64 = 1e3;
/// The values of μ, the price of the distance from the start; with the last one hardly any step pays.
const PRICES: [f64; 9] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
/// Errors below this count as this (m/s).
const MIN_ERROR_M_S: f64 = 1e-6;
/// A panic in a search ends the program.
const UNPOISONED: &str = "no search panicked";
/// Edge of the first simplex, as a factor.
const EDGE: f64 = 1.6;

/// A candidate that was tried: its coordinates, and the typical errors of coast and next sample in each block.
struct Tried {
    coordinates: Vec<f64>,
    blocks: Vec<[f64; 2]>,
}

/// Coordinates to configurations to costs.
pub(super) struct Search<'a> {
    start: &'a ConfigFile,
    base: Numbers,
    origin: [f64; N_NUMBERS],
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
    pub(super) numbers: Numbers,
    pub(super) config: ConfigFile,
    /// μ.
    pub(super) price: f64,
    /// exp J of each block, by the candidate that is chosen on the other blocks; 1 is the start.
    pub(super) cross_validated_ratio: f64,
    pub(super) n_tried: usize,
    pub(super) n_refused: usize,
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
        let base = Numbers::of(translation.context("the configuration has no [translation]")?, flight)?;
        Ok(Self {
            start,
            base,
            origin: base.origin(),
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
        let numbers = self.base.at(&chosen.coordinates).context("the best one is within the bounds")?;
        let n_refused = *self.refused.get_mut();
        Ok(Chosen {
            config: self.base.config(&numbers, self.start),
            numbers,
            price,
            cross_validated_ratio: cross_validated_cost.exp(),
            n_tried: tried.len() + n_refused,
            n_refused,
        })
    }

    /// Nelder–Mead from each start, all at once, then once more from the best of all.
    fn descend(&self, n_evaluations: u64) -> anyhow::Result<()> {
        let starts = self.base.starts();
        let each = n_evaluations / (starts.len() as u64 + 1);
        let corner = |factors: [f64; N_NUMBERS]| {
            let mut corner: Vec<f64> =
                factors.iter().zip(self.origin).map(|(factor, origin)| origin + factor.ln()).collect();
            corner.extend(self.with_mass.then_some(0.0));
            corner
        };
        std::thread::scope(|scope| {
            let searches =
                starts.map(|factors| scope.spawn(move || self.descend_from(corner(factors), each)));
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
            let edge = if axis == N_NUMBERS { 1.05_f64.ln() } else { EDGE.ln() };
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
        let origins = self.origin.into_iter().chain([0.0]);
        coordinates.iter().zip(origins).map(|(c, origin)| (c - origin).powi(2)).sum()
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
        let numbers = search.base.at(coordinates);
        let config = numbers.map(|numbers| search.base.config(&numbers, search.start));
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
