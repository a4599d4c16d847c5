//! Measures the contestants in turns, in small batches of one run, so that a slower clock or another process affects all of them
//! alike. Each step is timed separately, including the cost of the clock.

use super::arguments::StepArguments;
use super::channel::{INPUT, wandering_outputs};
use super::kalman::DisturbanceFilter;
use super::literal::{LiteralChannel, check_agreement};
use super::memory::MemoryProbe;
use super::report::{QUANTILES, Rival, Row, YARDSTICK};
use super::subject::{Solver, Stepped, Subject};
use crate::harness::latency::quantile;
use indicatif::ProgressBar;
use nalgebra::Vector3;
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// A size is measured in about this many rounds, each with a batch of every contestant.
const ROUNDS: usize = 100;
/// Even a slow machine gets this many rounds.
const MIN_ROUNDS: usize = 10;
/// A batch of another contestant takes no longer than this, if one step does not.
const BATCH_NS: u64 = 10_000_000;
/// Steps at the head of each batch that are not timed: they bring back what the others pushed out of the caches.
const UNTIMED_STEPS: usize = 3;
/// If a step takes longer, its factor is in no cache, and one step reloads the rest.
const LONG_STEP_NS: u64 = 1_000_000;
const WARM_UP: Duration = Duration::from_millis(100);
/// Steps before that, in which the learning ones are counted.
const MAX_COUNTED_STEPS: usize = 1000;
const MIN_COUNTED_STEPS: usize = 50;

/// Why the literal formula is not run.
const NOT_COMPARED: &str = "compared with the dense solver only";

/// The progress bar's length for one size.
pub(super) const PROGRESS: u64 = 100;

/// One contestant: its step on the i-th output, and how long each took.
struct Contestant<'a> {
    step: Box<dyn FnMut(usize) + 'a>,
    /// Counts steps, timed or not.
    at: usize,
    untimed_steps: usize,
    batch: usize,
    samples_ns: Vec<u64>,
}

impl<'a> Contestant<'a> {
    /// Runs for a while, and chooses its batch: as many steps as fit into `batch_ns`, at most `max_batch`.
    fn warmed_up(step: impl FnMut(usize) + 'a, batch_ns: u64, max_batch: usize) -> Self {
        let mut contestant =
            Self { step: Box::new(step), at: 0, untimed_steps: 0, batch: 1, samples_ns: Vec::new() };
        let started = Instant::now();
        while started.elapsed() < WARM_UP || contestant.at == 0 {
            contestant.time_one();
        }
        let median_ns = quantile(contestant.sorted_ns(), 0.5).max(1);
        contestant.untimed_steps = if median_ns > LONG_STEP_NS { 1 } else { UNTIMED_STEPS };
        contestant.batch = (batch_ns / median_ns).clamp(1, max_batch as u64) as usize;
        // Touched, so that no page is mapped while the clock runs.
        contestant.samples_ns.clear();
        contestant.samples_ns.resize(2 * ROUNDS * contestant.batch, 1);
        contestant.samples_ns.clear();
        contestant
    }

    fn time_one(&mut self) {
        let started = Instant::now();
        (self.step)(self.at);
        let elapsed = started.elapsed();
        self.samples_ns.push(elapsed.as_nanos() as u64);
        self.at += 1;
    }

    fn run_batch(&mut self) {
        for _ in 0..self.untimed_steps {
            (self.step)(self.at);
            self.at += 1;
        }
        (0..self.batch).for_each(|_| self.time_one());
    }

    fn sorted_ns(&mut self) -> &[u64] {
        self.samples_ns.sort_unstable();
        &self.samples_ns
    }

    fn rival(mut self) -> Rival {
        Rival { median_ns: quantile(self.sorted_ns(), 0.5), samples: self.samples_ns.len() }
    }
}

/// Measures a channel among those contestants that are run at its size.
pub(super) fn measure(
    mut subject: Subject,
    memory: &mut MemoryProbe,
    arguments: &StepArguments,
    progress: &ProgressBar,
) -> anyhow::Result<Row> {
    let outputs = wandering_outputs();
    let output = |i: usize| black_box(&outputs[i % outputs.len()]);
    let n_centers = subject.n_centers;

    let (mut literal, mut literal_force_difference) = (Err(NOT_COMPARED.to_owned()), None);
    if let (Solver::Dense, Stepped::Gradient(channel)) = (subject.solver, &mut subject.channel) {
        literal = arguments.literal(n_centers, || LiteralChannel::new(channel))?;
        if let Ok(literal) = &mut literal {
            literal_force_difference = Some(check_agreement(channel, literal, &outputs)?);
        }
    }
    let mut kalman = DisturbanceFilter::new();
    // The dense step of the gradient law with which the local solver and the joint law are compared.
    let mut dense = match subject.solver {
        Solver::Dense => None,
        Solver::Local(_) => Some(Subject::dense(YARDSTICK)?.channel),
        Solver::Joint => Some(Subject::dense(n_centers)?.channel),
    };

    let channel = &mut subject.channel;
    if let Some(channel) = channel.gradient_mut() {
        channel.set_rate(Vector3::zeros());
    }
    let mut literal_estimate = Vector3::zeros();
    let (mut n_open, mut n_counted, started) = (0, 0, Instant::now());
    while n_counted < MIN_COUNTED_STEPS || (n_counted < MAX_COUNTED_STEPS && started.elapsed() < WARM_UP) {
        channel.step(output(n_counted), &INPUT);
        n_open += usize::from(channel.has_learned());
        n_counted += 1;
    }

    let budget = Duration::from_secs_f64(arguments.seconds_per_size);
    let n_samples = arguments.samples as usize;
    let our_batch_ns = (budget / (2 * ROUNDS as u32)).as_nanos() as u64;
    let max_batch = n_samples.div_ceil(ROUNDS);
    let mut ours =
        Contestant::warmed_up(|i| channel.step(output(i), black_box(&INPUT)), our_batch_ns, max_batch);
    let mut literal = literal.as_mut().map(|literal| {
        let step = |i| {
            literal_estimate = literal.step(black_box(&literal_estimate), output(i), black_box(&INPUT)).0;
        };
        Contestant::warmed_up(step, BATCH_NS, max_batch)
    });
    let mut kalman_turns = Contestant::warmed_up(|i| kalman.step(output(i)), BATCH_NS, max_batch);
    let mut yardstick = dense.as_mut().map(|channel| {
        Contestant::warmed_up(|i| channel.step(output(i), black_box(&INPUT)), BATCH_NS, max_batch)
    });
    let mut reading = Contestant::warmed_up(|_| memory.read(), BATCH_NS, max_batch);

    let start_of_bar = progress.position();
    let (started, cpu_time_before) = (Instant::now(), cpu_time_s());
    for round in 0.. {
        let done = ours.samples_ns.len() as f64 / n_samples as f64;
        let spent = started.elapsed().as_secs_f64() / budget.as_secs_f64();
        progress.set_position(start_of_bar + (done.max(spent).min(1.0) * PROGRESS as f64) as u64);
        if done >= 1.0 || (round >= MIN_ROUNDS && spent >= 1.0) {
            break;
        }
        ours.batch = ours.batch.min(n_samples - ours.samples_ns.len());
        ours.run_batch();
        let others = literal.iter_mut().chain(&mut yardstick);
        for rival in others.chain([&mut kalman_turns, &mut reading]) {
            rival.run_batch();
        }
    }

    let core_share = (cpu_time_s() - cpu_time_before) / started.elapsed().as_secs_f64();
    let samples_ns = ours.sorted_ns();
    let row = Row {
        solver: subject.solver,
        n_centers,
        centers: subject.centers,
        set_up_s: subject.set_up_s,
        bytes: subject.bytes,
        predicted_error: subject.predicted_error,
        samples: samples_ns.len(),
        core_share,
        quantiles_ns: QUANTILES.map(|q| quantile(samples_ns, q)),
        dead_zone_open: n_open as f64 / n_counted as f64,
        memory_gb_per_s: MemoryProbe::gb_per_s(reading.rival().median_ns),
        literal: literal.map(Contestant::rival).map_err(|reason| reason.clone()),
        literal_force_difference,
        kalman: kalman_turns.rival(),
        yardstick: yardstick.map(Contestant::rival),
    };
    kalman.check()?;
    Ok(row)
}

/// The processor time that this thread has used.
fn cpu_time_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
