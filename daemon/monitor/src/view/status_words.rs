//! The meaning of each word of an estimate's status for the operator, and what to do about it: one row per word.
//!
//! [`shared_types::payload::status_bits`] documents what sets a bit. Counts, the service's start and the overall verdict are
//! in [`notes`](crate::view::notes).

use crate::model::{Model, Part};
use crate::view::format::{duration, duration_ns};
use shared_types::Status;
use shared_types::payload::status_bits as bits;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// As it should be.
    Good,
    /// Good to know.
    Info,
    /// Fly on, and look into it.
    Caution,
    /// Do not fly on this.
    Alarm,
}

/// When a word is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shown {
    /// While the newest estimate has the bit.
    Now,
    /// While an estimate of the last two seconds has it: a bit of a single estimate could not be read.
    Lately,
}

/// A word of the status.
struct Word {
    bit: u64,
    level: Level,
    shown: Shown,
    /// With one of these bits in the newest estimate it would say nothing new.
    unless: u64,
    /// What it means, and what to do.
    text: fn(&Model) -> String,
}

const fn word(bit: u64, level: Level, shown: Shown, unless: u64, text: fn(&Model) -> String) -> Word {
    Word { bit, level, shown, unless, text }
}

use Level::{Alarm, Caution, Info};
use Shown::{Lately, Now};

/// All words but those of good health (`tracking`, `adapting`) and `rejected-sample`, whose reasons are counted.
const WORDS: [Word; 20] = [
    word(bits::INVALID, Alarm, Now, 0, |_| {
        "the loop has been late for too long; lower rate_hz or use fewer centers; see daemon doctor".into()
    }),
    word(bits::WAITING, Alarm, Now, 0, |model| {
        let instance = &model.instance;
        format!("no sample yet; start the vehicle's process (it publishes {instance}/measurement)")
    }),
    word(bits::STALE, Alarm, Now, bits::WAITING, |model| {
        let age = model.status.map_or("some time".into(), |status| duration_ns(status.newest_sample_age_ns));
        format!("no good sample for {age}; does the vehicle's process run?")
    }),
    word(bits::STALE_TRANSLATION, Alarm, Now, bits::WAITING, |model| stale(model, Part::Translation)),
    word(bits::STALE_ROTATION, Alarm, Now, bits::WAITING, |model| stale(model, Part::Rotation)),
    word(bits::STALE_LINEAR, Alarm, Now, bits::WAITING, |model| stale(model, Part::Linear)),
    word(bits::PREDICT_ONLY, Caution, Now, 0, |_| {
        "the loop is late and uses no samples; lower rate_hz or use fewer centers".into()
    }),
    word(bits::LATE, Caution, Lately, bits::PREDICT_ONLY, |model| {
        match model.growth(|status| status.counters.deadline_misses) {
            0 => "a deadline was missed; see daemon doctor".into(),
            missed => format!("{missed} deadlines missed in 10 s; see daemon doctor"),
        }
    }),
    word(bits::COASTING_TRANSLATION, Caution, Now, bits::WAITING | bits::STALE_TRANSLATION, |model| {
        coasts(model, Part::Translation)
    }),
    word(bits::COASTING_ROTATION, Caution, Now, bits::WAITING | bits::STALE_ROTATION, |model| {
        coasts(model, Part::Rotation)
    }),
    word(bits::COASTING_LINEAR, Caution, Now, bits::WAITING | bits::STALE_LINEAR, |model| {
        coasts(model, Part::Linear)
    }),
    word(bits::REACQUIRING, Caution, Now, bits::WAITING, |_| {
        "measurements are back after an outage, but not near the prediction yet: the state is uncertain"
            .into()
    }),
    word(bits::CATCHING_UP, Caution, Now, 0, |_| {
        "samples that came late are put where they belong over some ticks; until then it is a prediction from before them"
            .into()
    }),
    word(bits::DIVERGED, Caution, Lately, 0, |_| {
        "the state left its limits and was put back to the last good one; look at the sensors and input.max_…"
            .into()
    }),
    word(bits::STUCK, Caution, Lately, 0, |model| {
        let which = grown(model, |status| status.counters.outputs_stuck);
        format!("the sensor of the {which} repeats one value to the bit; look at it (input.stuck)")
    }),
    word(bits::HELD_BACK, Caution, Lately, 0, |model| {
        let which = grown(model, |status| status.counters.outputs_held_back);
        format!("measurements of the {which} are outliers and are not used: spikes? (input.outliers)")
    }),
    word(bits::CLAMPED, Caution, Lately, 0, |_| {
        "learning is held at its limit of stability; lower adaptation_rate, see daemon check".into()
    }),
    word(bits::OUTSIDE_CENTERS, Info, Lately, bits::COASTING, |_| {
        "the motion is outside the box of the centers: nothing is learned there; widen centers_…".into()
    }),
    word(bits::FROZEN, Info, Now, 0, |_| {
        "an operator has frozen learning; what was learned is used; f: learn again".into()
    }),
    word(bits::ON_GROUND, Info, Now, 0, |_| {
        "the vehicle says that it stands on the ground: nothing is learned until it says otherwise".into()
    }),
];

/// The status in words, in the order of the table: how bad each is, the word, what it means and what to do.
pub fn explained(model: &Model) -> impl Iterator<Item = (Level, &'static str, String)> + '_ {
    let now = model.estimate.map_or(0, |estimate| estimate.status);
    let lately = model.recent_bits();
    WORDS.iter().filter_map(move |word| {
        let status = if word.shown == Now { now } else { lately };
        (status & word.bit != 0 && now & word.unless == 0 && !says_nothing_new(model, word.bit))
            .then(|| (word.level, bits::words(word.bit)[0], (word.text)(model)))
    })
}

fn coasts(model: &Model, part: Part) -> String {
    format!("{}: predicting", silence(model, part))
}

fn stale(model: &Model, part: Part) -> String {
    format!("{}; does its sensor work?", silence(model, part))
}

/// For how long a part was not measured.
fn silence(model: &Model, part: Part) -> String {
    let age_s = model.estimate.map_or(f64::INFINITY, |estimate| part.channel(&estimate).output_age_s);
    match age_s.is_finite() {
        true => format!("no {} for {}", part.output(), duration(age_s)),
        false => format!("no {} was ever measured", part.output()),
    }
}

/// The first part that is stale while another one is measured.
pub fn silent_part(model: &Model) -> Option<Part> {
    let status = model.estimate?.status;
    let is_stale = |part: &Part| status & part.stale_bit() != 0;
    let parts = model.parts();
    parts.iter().copied().find(is_stale).filter(|_| !parts.iter().all(is_stale))
}

/// Where all parts are silent, `stale` says it; where some are, their own words do.
fn says_nothing_new(model: &Model, bit: u64) -> bool {
    let is_stale = model.estimate.is_some_and(|estimate| estimate.status & bits::STALE != 0);
    let of_parts = Part::ALL.map(Part::stale_bit);
    let is_of_one = silent_part(model).is_some();
    is_stale && if bit == bits::STALE { is_of_one } else { of_parts.contains(&bit) && !is_of_one }
}

/// The quantities whose counts grew.
fn grown(model: &Model, counts: fn(&Status) -> [u64; 3]) -> String {
    let has_grown = |part: &Part| model.growth(|status| counts(status)[*part as usize]) > 0;
    let names: Vec<_> = Part::ALL.into_iter().filter(has_grown).map(Part::output).collect();
    if names.is_empty() { "output".into() } else { names.join(" and ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::News;
    use shared_types::Estimate;

    #[test]
    fn every_status_bit_is_explained_by_its_own_row() {
        for bit in (0..22).map(|k| 1 << k) {
            let mut model = Model::new("vehicle");
            let mut estimate = Estimate { publish_stamp_ns: 1, status: bit, ..Estimate::default() };
            estimate.translation.output_age_s = 0.8;
            model.note(News::Estimate(estimate));
            let words: Vec<_> = explained(&model).map(|(_, word, _)| word).collect();
            match bit {
                bits::TRACKING | bits::ADAPTING | bits::REJECTED_SAMPLE => assert!(words.is_empty()),
                _ => assert_eq!(words, bits::words(bit)),
            }
            if bit == bits::COASTING_TRANSLATION {
                assert_eq!(explained(&model).next().unwrap().2, "no velocity for 0.8 s: predicting");
            }
        }
    }
}
