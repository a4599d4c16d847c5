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
const WORDS: [Word; 14] = [
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
    word(bits::PREDICT_ONLY, Caution, Now, 0, |_| {
        "the loop is late and uses no samples; lower rate_hz or use fewer centers".into()
    }),
    word(bits::LATE, Caution, Lately, bits::PREDICT_ONLY, |model| {
        match model.growth(|status| status.counters.deadline_misses) {
            0 => "a deadline was missed; see daemon doctor".into(),
            missed => format!("{missed} deadlines missed in 10 s; see daemon doctor"),
        }
    }),
    word(bits::COASTING_TRANSLATION, Caution, Now, bits::WAITING, |model| coasts(model, Part::Translation)),
    word(bits::COASTING_ROTATION, Caution, Now, bits::WAITING, |model| coasts(model, Part::Rotation)),
    word(bits::COASTING_LINEAR, Caution, Now, bits::WAITING, |model| coasts(model, Part::Linear)),
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
];

/// The status in words, in the order of the table: how bad each is, the word, what it means and what to do.
pub fn explained(model: &Model) -> impl Iterator<Item = (Level, &'static str, String)> + '_ {
    let now = model.estimate.map_or(0, |estimate| estimate.status);
    let lately = model.recent_bits();
    WORDS.iter().filter_map(move |word| {
        let status = if word.shown == Now { now } else { lately };
        (status & word.bit != 0 && now & word.unless == 0)
            .then(|| (word.level, bits::words(word.bit)[0], (word.text)(model)))
    })
}

fn coasts(model: &Model, part: Part) -> String {
    let age_s = model.estimate.map_or(f64::INFINITY, |estimate| part.channel(&estimate).output_age_s);
    match age_s.is_finite() {
        true => format!("no {} for {}: predicting", part.output(), duration(age_s)),
        false => format!("no {} was ever measured: predicting", part.output()),
    }
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
        for bit in (0..17).map(|k| 1 << k) {
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
