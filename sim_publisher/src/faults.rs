//! Injects faults between the sensors and publication: a sample becomes none, one or two that are sent, now or later. No
//! clock and no file: the same samples, faults and seed give the same bits.
//!
//! A sample passes in this order, and within each step in the order in which the faults are stated:
//!
//! | step | faults |
//! |---|---|
//! | its values | freeze, spike, nan, bias, drift |
//! | whether it is sent | rate-change, drop, burst: its sequence is used up |
//! | its stamp | clock-jump |
//! | its way | delay, reorder, duplicate |
//!
//! [`crate::supervise`] stops and kills processes; this file only counts the samples that are lost with them.

mod spec;

pub use spec::{Fault, FaultError, Field, Kind, Reach, check_faults, help, read_faults};

use crate::delivery::{Delivery, Outgoing};
use crate::disturbance::white;
use crate::sensors::{Chance, wxyz};
use crate::simulation::SimulatedSample;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use shared_types::Measurement;
use shared_types::payload::valid;
use shared_types::table::Message;
use std::collections::VecDeque;
use std::iter::Peekable;

/// How many samples a fault concerned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tally {
    /// Which fault.
    pub fault: Fault,
    /// Samples lost, changed, sent late, overtaken or sent again, depending on its kind. Of a stop or kill: samples
    /// that were due meanwhile.
    pub samples: u64,
}

/// An active fault.
#[derive(Debug, Clone)]
struct Active {
    fault: Fault,
    random: ChaCha8Rng,
    /// Of the error of bias and drift.
    direction: Vector3<f64>,
    /// Samples so far that it might concern: the phase of "one in n".
    seen: u64,
    /// The sensor's last values of the fields that it has measured.
    last: Measurement,
    samples: u64,
}

/// All faults of a run.
#[derive(Debug, Clone)]
pub struct Faults {
    active: Vec<Active>,
    /// On their way, in the order of their arrival.
    queue: VecDeque<Delivery>,
    /// Until when the way is blocked by a delayed sample (ns), and the fault that delayed it.
    blocked_until_ns: u64,
    blocked_by: usize,
    /// Waits until the next one has passed it.
    overtaken: Option<Delivery>,
}

impl Faults {
    /// These faults, before the first sample; each has a random stream of its own.
    pub fn new(faults: &[Fault], seed: u64) -> Self {
        let active = |(i, &fault): (usize, &Fault)| {
            let mut random = Chance::Faults(i as u64).stream(seed);
            let direction = direction(&mut random);
            Active { fault, random, direction, seen: 0, last: Measurement::default(), samples: 0 }
        };
        Self {
            active: faults.iter().enumerate().map(active).collect(),
            queue: VecDeque::new(),
            blocked_until_ns: 0,
            blocked_by: 0,
            overtaken: None,
        }
    }

    /// Takes the next sample; [`Faults::take_due`] returns what is to be sent. `false` if the sample is lost.
    pub fn pass(&mut self, mut sample: Measurement) -> bool {
        let t_ns = sample.stamp_ns;
        for fault in &mut self.active {
            fault.distort(&mut sample);
        }
        // Every fault is evaluated, so that each draws once for each sample.
        let lost = self.active.iter_mut().fold(false, |lost, fault| fault.loses(&mut sample, lost));
        if lost {
            return false;
        }
        let mut clock_error_ns = 0;
        let mut at_ns = t_ns;
        let (mut copies, mut waits) = (1, false);
        for (i, fault) in self.active.iter_mut().enumerate() {
            if !fault.fault.span.contains_ns(t_ns) {
                continue;
            }
            let kind = fault.fault.kind;
            match kind {
                Kind::ClockJump { by_s } => {
                    clock_error_ns += (by_s * 1e9) as i64;
                    fault.samples += 1;
                }
                Kind::Delay { by_s } => {
                    at_ns += (by_s * 1e9).round() as u64;
                    if at_ns >= self.blocked_until_ns {
                        (self.blocked_until_ns, self.blocked_by) = (at_ns, i);
                    }
                }
                Kind::Reorder { every } if fault.is_one_in(every) && self.overtaken.is_none() => {
                    waits = true;
                    fault.samples += 1;
                }
                Kind::Duplicate { every } if fault.is_one_in(every) => {
                    copies += 1;
                    fault.samples += 1;
                }
                Kind::Stop | Kind::Kill => fault.samples += 1,
                _ => {}
            }
        }
        // Samples keep their order on the way: one that is not delayed itself waits for one that is.
        at_ns = at_ns.max(self.blocked_until_ns);
        if at_ns > t_ns {
            self.active[self.blocked_by].samples += 1;
        }
        let delivery = Delivery { at_ns, measurement: sample, clock_error_ns, source: 0 };
        match self.overtaken.take() {
            None if waits => self.overtaken = Some(delivery),
            overtaken => {
                self.queue.extend(std::iter::repeat_n(delivery, copies));
                self.queue.extend(overtaken.map(|overtaken| Delivery { at_ns, ..overtaken }));
            }
        }
        true
    }

    /// The next sample that is due before `before_ns`.
    pub fn take_due(&mut self, before_ns: u64) -> Option<Delivery> {
        let is_due = self.queue.front().is_some_and(|next| next.at_ns < before_ns);
        if is_due { self.queue.pop_front() } else { None }
    }

    /// No sample follows the one of `last_ns`: nothing waits any more to be overtaken.
    pub fn end(&mut self, last_ns: u64) {
        let overtaken = self.overtaken.take();
        self.queue.extend(overtaken.map(|waiting| Delivery { at_ns: waiting.at_ns.max(last_ns), ..waiting }));
    }

    /// How many samples each fault concerned so far, in the order of the faults.
    pub fn tallies(&self) -> Vec<Tally> {
        self.active
            .iter()
            .map(|Active { fault, samples, .. }| Tally { fault: *fault, samples: *samples })
            .collect()
    }
}

impl Active {
    /// One sample in n, beginning with the first one.
    fn is_one_in(&mut self, every: u64) -> bool {
        self.seen += 1;
        (self.seen - 1).is_multiple_of(every)
    }

    /// Changes the values that the sensor gives.
    fn distort(&mut self, sample: &mut Measurement) {
        let Fault { kind, field, span } = self.fault;
        let fields = field.bits & measured() & sample.valid;
        if fields == 0 {
            return;
        }
        let active = span.contains_ns(sample.stamp_ns);
        match kind {
            Kind::Freeze => {
                let known = if active { fields & self.last.valid } else { 0 };
                self.samples += u64::from(known != 0);
                copy(known, &self.last, sample);
                copy(fields & !known, sample, &mut self.last);
                self.last.valid |= fields;
            }
            _ if !active => {}
            Kind::Spike { size, every } if self.is_one_in(every) => {
                let error = size * direction(&mut self.random);
                add(fields, &error, sample);
                self.samples += 1;
            }
            Kind::Nan { every } if self.is_one_in(every) => {
                for (place, _, _) in Field::places().filter(|(_, place, _)| fields & place.valid != 0) {
                    sample.numbers_mut(place).fill(f64::NAN);
                }
                self.samples += 1;
            }
            Kind::Bias { size } => {
                add(fields, &(size * self.direction), sample);
                self.samples += 1;
            }
            Kind::Drift { per_s } => {
                let since_s = sample.stamp_ns as f64 * 1e-9 - span.start_s;
                add(fields, &(per_s * since_s * self.direction), sample);
                self.samples += 1;
            }
            _ => {}
        }
    }

    /// Removes the field from the sample; `true` if no field is left, or the sample was lost before.
    fn loses(&mut self, sample: &mut Measurement, lost_before: bool) -> bool {
        let Fault { kind, field, span } = self.fault;
        let fields = field.bits & measured() & sample.valid;
        let chance: f64 = if matches!(kind, Kind::Drop { .. }) { self.random.random() } else { 1.0 };
        if fields == 0 || !span.contains_ns(sample.stamp_ns) {
            return lost_before;
        }
        let lost = match kind {
            Kind::Drop { probability } => chance < probability,
            Kind::Burst => true,
            Kind::RateChange { divide_by } => !self.is_one_in(divide_by),
            _ => false,
        };
        if lost_before {
            return true;
        }
        self.samples += u64::from(lost);
        if lost && field != Field::ALL {
            sample.valid &= !fields;
        }
        lost && (field == Field::ALL || sample.valid == 0)
    }
}

/// The bits of all fields that a fault may concern.
fn measured() -> u32 {
    Field::places().fold(0, |bits, (_, field, _)| bits | field.valid)
}

fn direction(random: &mut ChaCha8Rng) -> Vector3<f64> {
    // Never the zero vector: that would be a chance of 2^-150.
    white(random).normalize()
}

/// Copies the values of these fields.
fn copy(fields: u32, from: &Measurement, to: &mut Measurement) {
    for (place, _, _) in Field::places().filter(|(_, field, _)| fields & field.valid != 0) {
        to.numbers_mut(place).copy_from_slice(from.numbers(place));
    }
    if fields & valid::VELOCITY != 0 {
        to.velocity_frame = from.velocity_frame;
    }
}

/// Adds an error to these fields; to the attitude as a rotation about the body axes.
fn add(fields: u32, error: &Vector3<f64>, sample: &mut Measurement) {
    for (place, _, _) in Field::places().filter(|(_, field, _)| fields & field.valid != 0) {
        match sample.numbers_mut(place) {
            [w, x, y, z] => {
                let attitude = UnitQuaternion::from_quaternion(Quaternion::new(*w, *x, *y, *z));
                [*w, *x, *y, *z] = wxyz(&(attitude * UnitQuaternion::new(*error)));
            }
            values => values.iter_mut().zip(error).for_each(|(value, error)| *value += error),
        }
    }
}

/// The samples of a simulation with faults, as they are sent: in the order of their instants, each true state at its
/// own.
#[derive(Debug)]
pub struct Faulty<Source: Iterator<Item = SimulatedSample>> {
    source: Peekable<Source>,
    faults: Faults,
    /// Due at the instant of the newest true state, after it.
    ready: VecDeque<Outgoing>,
    newest_ns: u64,
}

impl<Source: Iterator<Item = SimulatedSample>> Faulty<Source> {
    /// These samples with these faults.
    pub fn new(source: Source, faults: Faults) -> Self {
        Self { source: source.peekable(), faults, ready: VecDeque::new(), newest_ns: 0 }
    }

    /// How many samples each fault concerned so far.
    pub fn tallies(&self) -> Vec<Tally> {
        self.faults.tallies()
    }
}

impl<Source: Iterator<Item = SimulatedSample>> Iterator for Faulty<Source> {
    type Item = Outgoing;

    fn next(&mut self) -> Option<Outgoing> {
        if let Some(ready) = self.ready.pop_front() {
            return Some(ready);
        }
        let next_ns = self.source.peek().map(|sample| sample.truth.stamp_ns);
        if next_ns.is_none() {
            self.faults.end(self.newest_ns);
        }
        if let Some(due) = self.faults.take_due(next_ns.unwrap_or(u64::MAX)) {
            return Some(due.into());
        }
        let SimulatedSample { truth, measurement, .. } = self.source.next()?;
        self.newest_ns = truth.stamp_ns;
        let is_lost = !measurement.is_some_and(|measurement| self.faults.pass(measurement));
        let mut first = Outgoing { at_ns: truth.stamp_ns, truth: Some(truth), delivery: None, is_lost };
        while let Some(due) = self.faults.take_due(truth.stamp_ns + 1) {
            match first.delivery {
                None => first.delivery = Some(due),
                Some(_) => self.ready.push_back(due.into()),
            }
        }
        Some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::spec::tests::any_fault;
    use super::*;
    use crate::sensors::{Outage, Span};
    use crate::{Scenario, Simulation, SimulationOptions};
    use proptest::prelude::*;
    use std::collections::HashSet;

    const PERIOD_NS: u64 = 5_000_000;

    fn options() -> SimulationOptions {
        SimulationOptions {
            duration_s: Some(6.0),
            position_fix_hz: Some(10.0),
            ..SimulationOptions::of(Scenario::RigidBody)
        }
    }

    fn samples() -> Vec<SimulatedSample> {
        Simulation::new(&options()).unwrap().collect()
    }

    fn faults(text: &str) -> Vec<Fault> {
        read_faults(&[text.to_owned()]).unwrap()
    }

    /// What is sent, and the tallies.
    fn sent(source: &[SimulatedSample], faults: &[Fault], seed: u64) -> (Vec<Outgoing>, Vec<u64>) {
        let mut faulty = Faulty::new(source.iter().copied(), Faults::new(faults, seed));
        let outgoing = faulty.by_ref().collect();
        (outgoing, faulty.tallies().iter().map(|tally| tally.samples).collect())
    }

    fn deliveries(outgoing: &[Outgoing]) -> Vec<Delivery> {
        outgoing.iter().filter_map(|outgoing| outgoing.delivery).collect()
    }

    fn with(text: &str) -> (Vec<Delivery>, Vec<u64>) {
        let (outgoing, tallies) = sent(&samples(), &faults(text), 1);
        (deliveries(&outgoing), tallies)
    }

    /// Bit for bit, not-a-numbers included.
    fn bits(outgoing: &[Outgoing]) -> Vec<String> {
        outgoing.iter().map(|outgoing| format!("{outgoing:?}")).collect()
    }

    /// The samples of the run without faults that are in the span.
    fn within(span: Span) -> impl Iterator<Item = Measurement> {
        let measured = samples().into_iter().map(|sample| sample.measurement.unwrap());
        measured.filter(move |sample| span.contains_ns(sample.stamp_ns))
    }

    #[test]
    fn without_faults_nothing_changes() {
        let lossy = SimulationOptions {
            outages: vec![Outage { start_s: 1.0, length_s: 0.1 }],
            jitter_us: 300.0,
            ..options()
        };
        for options in [options(), lossy] {
            let source: Vec<_> = Simulation::new(&options).unwrap().collect();
            let (outgoing, tallies) = sent(&source, &[], 1);
            let plain: Vec<_> = source.into_iter().map(Outgoing::from).collect();
            assert_eq!((outgoing, tallies), (plain, vec![]));
        }
    }

    #[test]
    fn lost_samples_are_counted_and_leave_the_others_alone() {
        for (text, lost) in
            [("burst@1:0.5", 100), ("rate-change@1:1,divide_by=4", 150), ("drop@1:2,probability=1", 400)]
        {
            let (deliveries, tallies) = with(text);
            assert_eq!((tallies, deliveries.len()), (vec![lost], 1200 - lost as usize), "{text}");
            let plain = samples();
            for delivery in deliveries {
                let sample = plain[delivery.measurement.sequence as usize].measurement.unwrap();
                let at_ns = sample.stamp_ns;
                assert_eq!(delivery, Delivery { at_ns, measurement: sample, clock_error_ns: 0, source: 0 });
            }
        }
        // 400 chances of 0.3: mean 120, standard deviation 9.2.
        let (_, tallies) = with("drop@1:2,probability=0.3");
        assert!((83..157).contains(&tallies[0]), "{tallies:?}");
    }

    #[test]
    fn a_field_is_lost_alone() {
        let (deliveries, tallies) =
            with("burst@1:0.5,field=velocity; rate-change@2:1,field=attitude,divide_by=5");
        assert_eq!((tallies, deliveries.len()), (vec![100, 160], 1200));
        for Delivery { measurement: m, .. } in deliveries {
            let (in_burst, in_change) = ((200..300).contains(&m.sequence), (400..600).contains(&m.sequence));
            assert_eq!(m.has(valid::VELOCITY), !in_burst);
            assert_eq!(m.has(valid::ATTITUDE), !in_change || m.sequence.is_multiple_of(5));
            assert!(m.has(valid::ANGULAR_VELOCITY | valid::FORCE));
        }
    }

    #[test]
    fn a_frozen_sensor_repeats_its_last_value_exactly() {
        let (deliveries, tallies) = with("freeze@1:0.5,field=velocity; freeze@2:1,field=position");
        // Fixes at 10 Hz: only the samples that carry one.
        assert_eq!(tallies, vec![100, 10]);
        let before = deliveries[199].measurement.velocity_m_s;
        let fix = deliveries[380].measurement.position_m;
        for (delivery, plain) in deliveries.iter().zip(samples()) {
            let (m, plain) = (delivery.measurement, plain.measurement.unwrap());
            match m.sequence {
                200..300 => assert_eq!(Measurement { velocity_m_s: plain.velocity_m_s, ..m }, plain),
                _ => assert_eq!(m.velocity_m_s, plain.velocity_m_s),
            }
            assert!(!(200..300).contains(&m.sequence) || m.velocity_m_s == before);
            assert!(!((400..600).contains(&m.sequence) && m.has(valid::POSITION)) || m.position_m == fix);
        }
    }

    #[test]
    fn errors_have_the_stated_size() {
        let text =
            "spike@1:1,size=3,every=10; bias@2:1,size=0.5,field=attitude; drift@3:2,per_s=0.4,field=all";
        let (deliveries, tallies) = with(text);
        assert_eq!(tallies, vec![20, 200, 400]);
        let mut spikes = HashSet::new();
        for (delivery, plain) in deliveries.iter().zip(samples()) {
            let (m, plain) = (delivery.measurement, plain.measurement.unwrap());
            let error = (Vector3::from(m.velocity_m_s) - Vector3::from(plain.velocity_m_s)).norm();
            let unit = |[w, x, y, z]: [f64; 4]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            let turned = unit(m.attitude_wxyz).angle_to(&unit(plain.attitude_wxyz));
            let drifted = 0.4 * (m.stamp_ns as f64 * 1e-9 - 3.0);
            let (velocity, attitude) = match m.sequence {
                200..400 if m.sequence % 10 == 0 => (3.0, 0.0),
                400..600 => (0.0, 0.5),
                600..1000 => (drifted, drifted),
                _ => (0.0, 0.0),
            };
            // Rounding; an angle near zero comes from an arc cosine of almost 1, good to 1e-8.
            assert!((error - velocity).abs() < 1e-12, "sample {}: {error}", m.sequence);
            assert!((turned - attitude).abs() < 1e-7, "sample {}: {turned}", m.sequence);
            if velocity == 3.0 {
                spikes.insert((m.velocity_m_s[0] - plain.velocity_m_s[0]).to_bits());
            }
        }
        assert_eq!(spikes.len(), 20, "each spike has a direction of its own");
    }

    #[test]
    fn not_a_number_comes_in_the_field_asked_for() {
        let (deliveries, tallies) = with("nan@1:1,every=2; nan@3:0.5,field=attitude");
        assert_eq!(tallies, vec![100, 100]);
        for Delivery { measurement: m, .. } in deliveries {
            let all = (200..400).contains(&m.sequence) && m.sequence.is_multiple_of(2);
            let attitude = all || (600..700).contains(&m.sequence);
            assert_eq!(m.velocity_m_s.iter().all(|v| v.is_nan()), all);
            assert_eq!(m.attitude_wxyz.iter().all(|v| v.is_nan()), attitude);
            assert!(m.force_n.iter().all(|v| v.is_finite()));
        }
    }

    #[test]
    fn delayed_samples_keep_their_order_and_their_stamps() {
        let (deliveries, tallies) = with("delay@1:1,by_s=0.1");
        assert_eq!(deliveries.len(), 1200);
        let late = deliveries.iter().filter(|d| d.at_ns > d.measurement.stamp_ns).count() as u64;
        // 200 of the fault, and those of the next 0.1 s, which wait for the last of them: it arrives at 2.095 s.
        assert_eq!((late, tallies), (219, vec![219]));
        for (sequence, delivery) in deliveries.iter().enumerate() {
            let stamp_ns = sequence as u64 * PERIOD_NS;
            assert_eq!(
                (delivery.measurement.sequence, delivery.measurement.stamp_ns),
                (sequence as u64, stamp_ns)
            );
            let at_ns = match sequence {
                200..400 => stamp_ns + 100_000_000,
                400..419 => 2_095_000_000,
                _ => stamp_ns,
            };
            assert_eq!(delivery.at_ns, at_ns, "sample {sequence}");
        }
    }

    #[test]
    fn neighbours_change_places() {
        let (deliveries, tallies) = with("reorder@1:1,every=4");
        assert_eq!((tallies, deliveries.len()), (vec![50], 1200));
        let order: Vec<u64> = deliveries[198..206].iter().map(|d| d.measurement.sequence).collect();
        assert_eq!(order, [198, 199, 201, 200, 202, 203, 205, 204]);
        assert_eq!(deliveries[203].at_ns, deliveries[203].measurement.stamp_ns);
        assert_eq!(deliveries[201].at_ns, 201 * PERIOD_NS);
        // Nothing follows the very last one.
        let (deliveries, _) = with("reorder@5.99:1,every=2; burst@5.995:1");
        assert_eq!(deliveries.last().unwrap().measurement.sequence, 1198);
    }

    #[test]
    fn duplicates_are_the_same_sample_again() {
        let (deliveries, tallies) = with("duplicate@1:1,every=2");
        assert_eq!((tallies, deliveries.len()), (vec![100], 1300));
        let again = deliveries.windows(2).filter(|pair| pair[0] == pair[1]).count();
        assert_eq!(again, 100);
    }

    #[test]
    fn a_wrong_clock_changes_nothing_but_the_stamp() {
        let (deliveries, tallies) = with("clock-jump@1:1,by_s=-2.5");
        assert_eq!((tallies, deliveries.len()), (vec![200], 1200));
        for delivery in deliveries {
            let wrong = (200..400).contains(&delivery.measurement.sequence);
            assert_eq!(delivery.clock_error_ns, if wrong { -2_500_000_000 } else { 0 });
            assert_eq!(delivery.at_ns, delivery.measurement.stamp_ns);
        }
    }

    #[test]
    fn samples_of_a_process_that_is_away_are_counted() {
        let (deliveries, tallies) = with("stop@1:0.5; kill@2:1");
        assert_eq!((tallies, deliveries.len()), (vec![100, 200], 1200));
    }

    /// A fault that draws does not change what another one draws.
    #[test]
    fn each_fault_has_chance_of_its_own() {
        let alone = with("drop@1:2,probability=0.5").1;
        let beside = with("drop@1:2,probability=0.5; spike@3:1,size=2,every=1").1;
        assert_eq!(alone[0], beside[0]);
        let (first, second) = (
            with("drop@1:2,probability=0.5; drop@1:2,probability=0"),
            with("drop@1:2,probability=0; drop@1:2,probability=0.5"),
        );
        let sequences = |sent: &[Delivery]| sent.iter().map(|d| d.measurement.sequence).collect::<Vec<_>>();
        assert_ne!(sequences(&first.0), sequences(&second.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn the_same_seed_gives_the_same_bits_in_the_order_of_time(
            faults in prop::collection::vec(any_fault(), 0..5), seed in 0..4u64
        ) {
            let source = samples();
            let (outgoing, tallies) = sent(&source, &faults, seed);
            prop_assert_eq!(bits(&outgoing), bits(&sent(&source, &faults, seed).0));
            prop_assert!(outgoing.windows(2).all(|pair| pair[0].at_ns <= pair[1].at_ns));
            // The truth passes untouched, each state once.
            let truths: Vec<_> = outgoing.iter().filter_map(|outgoing| outgoing.truth).collect();
            prop_assert_eq!(truths, source.iter().map(|sample| sample.truth).collect::<Vec<_>>());
            // Every sample is either lost, or sent and as often again as was counted; none is early.
            let lost = outgoing.iter().filter(|outgoing| outgoing.is_lost).count() as u64;
            let again: u64 = faults.iter().zip(&tallies)
                .filter(|(fault, _)| matches!(fault.kind, Kind::Duplicate { .. }))
                .map(|(_, samples)| samples).sum();
            let sent = deliveries(&outgoing);
            let different = sent.iter().map(|d| d.measurement.sequence).collect::<HashSet<_>>().len() as u64;
            prop_assert_eq!(different + lost, 1200);
            prop_assert!(sent.len() as u64 <= different + again);
            prop_assert!(sent.iter().all(|d| d.at_ns >= d.measurement.stamp_ns));
        }

        /// Outside of a fault's time and of what it delayed, samples are those of the run without it.
        #[test]
        fn a_fault_changes_nothing_outside_its_time(fault in any_fault(), seed in 0..4u64) {
            let source = samples();
            let (outgoing, tallies) = sent(&source, &[fault], seed);
            let mut changed = 0;
            for delivery in deliveries(&outgoing) {
                let plain = source[delivery.measurement.sequence as usize].measurement.unwrap();
                let same = format!("{:?}", delivery.measurement) == format!("{plain:?}");
                let inside = fault.span.contains_ns(plain.stamp_ns);
                prop_assert!(same && delivery.clock_error_ns == 0 || inside);
                changed += u64::from(!same);
            }
            let possible = within(fault.span).count() as u64;
            prop_assert!(changed <= tallies[0] && changed <= possible);
            let delays = matches!(fault.kind, Kind::Delay { .. });
            prop_assert!(delays || tallies[0] <= possible);
        }
    }
}
