//! Notes on the present state, as sentences, and the overall verdict.
//!
//! The words of the status are explained in [`status_words`](crate::view::status_words).

use crate::model::{Model, Presence};
use crate::view::format::{duration_ns, utc};
use crate::view::status_words::{Level, explained, silent_part};
use shared_types::Status;
use shared_types::payload::{real_time, restored, status_bits as bits};

/// One note.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Its severity.
    pub level: Level,
    /// The word of the status, or what it is about.
    pub word: &'static str,
    /// What it means, and what to do.
    pub text: String,
}

/// The instant of a view.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// CLOCK_MONOTONIC (ns).
    pub monotonic_ns: u64,
    /// Seconds since 1970, UTC.
    pub unix_s: u64,
}

impl Now {
    /// The time of the day at an earlier instant.
    fn time_of(self, at_ns: u64) -> String {
        utc(self.unix_s.saturating_sub(self.monotonic_ns.saturating_sub(at_ns) / 1_000_000_000))
    }
}

/// In one line: whether the estimate may be used for flight.
pub fn verdict(model: &Model, now: Now) -> (Level, String) {
    if let Presence::Away { since_ns, .. } = &model.presence {
        let since = now.time_of(*since_ns);
        let for_s = duration_ns(now.monotonic_ns.saturating_sub(*since_ns));
        return match model.estimate {
            Some(_) => (
                Level::Alarm,
                format!("DO NOT FLY ON THIS: the service is away since {since} ({for_s}), waiting"),
            ),
            None => (Level::Alarm, format!("NO SERVICE yet; waiting since {since} ({for_s})")),
        };
    }
    let Some(estimate) = model.estimate else {
        return (Level::Alarm, "looking for the service".into());
    };
    let has = |bit: u64| estimate.status & bit != 0;
    let learning = match () {
        () if has(bits::FROZEN) => "learning is frozen",
        () if has(bits::ON_GROUND) => "on the ground, nothing is learned",
        () if model.recent_bits() & bits::ADAPTING != 0 => "learning",
        () => "nothing to learn now",
    };
    let silent = silent_part(model).map_or("sample", |part| part.output());
    let why_not = [
        (bits::INVALID, "the loop is late".to_owned()),
        (bits::WAITING, "no sample yet".to_owned()),
        (bits::STALE, format!("no {silent} comes")),
    ];
    if let Some((_, why)) = why_not.into_iter().find(|&(bit, _)| has(bit)) {
        return (Level::Alarm, format!("DO NOT FLY ON THIS: {why}"));
    }
    if has(bits::COASTING | bits::PREDICT_ONLY) {
        return (Level::Caution, "COASTING: predicting with what was learned".into());
    }
    if has(bits::REACQUIRING) {
        return (Level::Caution, "REACQUIRING after an outage: the state is uncertain".into());
    }
    match notes(model, now).iter().map(|note| note.level).max() {
        Some(Level::Alarm | Level::Caution) => {
            (Level::Caution, format!("TRACKING, {learning}; but see below"))
        }
        _ => (Level::Good, format!("TRACKING, {learning}")),
    }
}

/// All notes, the worst first.
pub fn notes(model: &Model, now: Now) -> Vec<Note> {
    let mut notes = Vec::new();
    let mut note = |level: Level, word: &'static str, text: String| notes.push(Note { level, word, text });
    if let Presence::Away { why, .. } = &model.presence {
        note(Level::Alarm, "away", why.clone());
        if model.estimate.is_some() {
            note(
                Level::Info,
                "below",
                "what was heard last; it goes on by itself when the service is back".into(),
            );
        }
        return notes;
    }
    for (level, word, text) in explained(model) {
        note(level, word, text);
    }
    if let Some(status) = &model.status {
        of_counters(model, status, &mut note);
        of_the_start(model, status, now, &mut note);
    }
    notes.sort_by_key(|note| std::cmp::Reverse(note.level));
    notes
}

fn of_counters(model: &Model, status: &Status, note: &mut impl FnMut(Level, &'static str, String)) {
    let mut rejected: Vec<_> = model
        .rejections()
        .into_iter()
        .map(|(reason, _)| (model.growth(|status| status.counters.rejected(reason)), reason.words()))
        .filter(|&(count, _)| count > 0)
        .collect();
    rejected.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
    if !rejected.is_empty() {
        let reasons: Vec<_> = rejected.iter().map(|(count, words)| format!("{count} {words}")).collect();
        note(Level::Caution, "rejected-sample", format!("in 10 s: {}", reasons.join(", ")));
    }
    let lost = model.growth(|status| status.counters.samples_lost);
    if lost > 0 {
        note(Level::Info, "lost", format!("{lost} samples never arrived in 10 s (gaps in their sequence)"));
    }
    if status.other_source_pid != 0 {
        let pid = status.other_source_pid;
        note(
            Level::Caution,
            "other source",
            format!("process {pid} publishes too and is refused; stop one of the two (input.source)"),
        );
    }
    let missed = model.growth(|status| status.counters.deadline_misses);
    if missed > 0 && model.recent_bits() & (bits::LATE | bits::PREDICT_ONLY | bits::INVALID) == 0 {
        note(Level::Info, "deadlines", format!("{missed} missed in 10 s; see daemon doctor"));
    }
    if model.growth(|status| status.snapshots_failed) > 0 {
        note(
            Level::Caution,
            "snapshot",
            "could not be written: what is learned would be lost; is the disk full? (the service's log)"
                .into(),
        );
    }
    let not_recorded = model.growth(|status| status.counters.ticks_not_recorded);
    if not_recorded > 0 {
        note(
            Level::Caution,
            "flight record",
            format!("{not_recorded} ticks not recorded in 10 s: the disk is slow"),
        );
    }
    let refused = real_time::words(status.real_time_requested & !status.real_time_granted);
    if !refused.is_empty() {
        note(
            Level::Info,
            "real time",
            format!("the system refused: {}; why: daemon control status", refused.join(", ")),
        );
    }
}

fn of_the_start(
    model: &Model,
    status: &Status,
    now: Now,
    note: &mut impl FnMut(Level, &'static str, String),
) {
    /// How long after its start the service's start is news (ns).
    const NEWS_NS: u64 = 15_000_000_000;
    let age_ns = now.monotonic_ns.saturating_sub(status.start_stamp_ns);
    if age_ns > NEWS_NS {
        return;
    }
    let with = match status.snapshot_restored {
        restored::LEARNED => "with what an earlier run had learned",
        restored::LEARNED_AND_STATE => "with what an earlier run had learned, and its state",
        _ => "with nothing learned",
    };
    let again = if model.restarts > 0 { "again " } else { "" };
    note(Level::Info, "started", format!("{again}{} ago, {with}", duration_ns(age_ns)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::News;
    use shared_types::{Counters, Estimate};

    const NOW: Now = Now { monotonic_ns: 100_000_000_000, unix_s: 1_700_000_000 };

    fn with_status(status: u64) -> Model {
        let mut model = Model::new("vehicle");
        let mut estimate = Estimate { publish_stamp_ns: NOW.monotonic_ns, status, ..Estimate::default() };
        estimate.translation.output_age_s = 0.8;
        model.note(News::Estimate(estimate));
        model
    }

    #[test]
    fn the_verdict_is_that_of_the_worst() {
        let level = |status: u64| verdict(&with_status(status), NOW).0;
        assert_eq!(level(bits::TRACKING | bits::ADAPTING), Level::Good);
        assert_eq!(level(bits::TRACKING | bits::FROZEN), Level::Good);
        assert_eq!(level(bits::TRACKING | bits::CLAMPED), Level::Caution);
        assert_eq!(level(bits::COASTING_ROTATION), Level::Caution);
        assert_eq!(level(bits::REACQUIRING), Level::Caution);
        assert_eq!(level(bits::TRACKING | bits::ON_GROUND), Level::Good);
        for alarm in [bits::STALE, bits::WAITING, bits::INVALID] {
            assert_eq!(level(bits::TRACKING | alarm), Level::Alarm);
        }
    }

    #[test]
    fn a_service_that_is_away_is_said_to_be_with_its_time() {
        let mut model = with_status(bits::TRACKING);
        let since_ns = NOW.monotonic_ns - 12_000_000_000;
        model.note(News::Away { since_ns, why: "no process runs it".into() });
        let (level, text) = verdict(&model, NOW);
        assert_eq!(level, Level::Alarm);
        assert_eq!(text, "DO NOT FLY ON THIS: the service is away since 22:13:08 UTC (12 s), waiting");
        assert_eq!(notes(&model, NOW)[0].text, "no process runs it");
    }

    #[test]
    fn reasons_are_counted_from_ten_seconds_ago() {
        let mut model = with_status(bits::TRACKING);
        let status = |stamp_s: u64, not_finite: u64| Status {
            stamp_ns: stamp_s * 1_000_000_000,
            counters: Counters {
                samples_rejected: [not_finite, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
                ..Counters::default()
            },
            ..Status::default()
        };
        for (stamp_s, not_finite) in [(80, 1), (95, 2), (100, 5)] {
            model.note(News::Status(status(stamp_s, not_finite)));
        }
        let notes = notes(&model, NOW);
        assert_eq!((notes[0].word, notes[0].text.as_str()), ("rejected-sample", "in 10 s: 3 not finite"));
    }
}
