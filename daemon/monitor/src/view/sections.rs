//! The parts of the view as lines of text. [`draw`](crate::view::draw) places them.

use crate::model::{Model, Part, Presence, Vector};
use crate::view::format::{
    cut, deviation, duration, duration_ns, magnitude, micros, number, running, wrapped,
};
use crate::view::notes::{Note, Now, notes, verdict};
use crate::view::status_words::Level;
use crate::view::theme::Theme;
use ratatui::text::{Line, Span};
use shared_types::payload::{LatencySummary, real_time, restored, status_bits};

/// Columns of a section's labels.
pub const LABEL: usize = 14;
/// Columns of the whole table of trust.
pub const TRUST_COLUMNS: usize = 96;

/// Left and right text in one line, the right one only where there is room.
pub fn both_sides(left: &str, right: &str, width: usize) -> String {
    let (n_left, n_right) = (left.chars().count(), right.chars().count());
    if n_left + n_right + 2 > width {
        return left.into();
    }
    format!("{left}{}{right}", " ".repeat(width - n_left - n_right))
}

/// Which service this is.
pub fn heading(model: &Model, theme: Theme, width: usize) -> Line<'static> {
    let mut left = format!(" {}", model.instance);
    if let Some(status) = &model.status {
        left += &format!(
            "  {} Hz  up {}  ticks {}",
            status.rate_millihertz as f64 / 1e3,
            running(status.stamp_ns.saturating_sub(status.start_stamp_ns)),
            status.counters.ticks
        );
        if model.restarts > 0 {
            left += &format!("  restarts {}", model.restarts);
        }
    }
    Line::styled(both_sides(&left, "monitor ", width), theme.title())
}

/// The verdict: whether the estimate may be used for flight.
pub fn verdict_line(model: &Model, now: Now, theme: Theme, width: usize) -> Line<'static> {
    let (level, text) = verdict(model, now);
    let age = match model.estimate_age_ns(now.monotonic_ns) {
        // The banner says it.
        _ if matches!(model.presence, Presence::Away { .. }) => String::new(),
        None => String::new(),
        Some(age_ns) => format!("estimate {} old ", duration_ns(age_ns)),
    };
    Line::styled(both_sides(&format!(" {text}"), &age, width), theme.banner(level))
}

/// The notes, in at most `n_lines` lines; the last line says how many do not fit.
pub fn note_lines(model: &Model, now: Now, theme: Theme, width: usize, n_lines: usize) -> Vec<Line<'static>> {
    let notes = notes(model, now);
    let mut lines: Vec<Line> = Vec::new();
    for (k, note) in notes.iter().enumerate() {
        let of_note = lines_of(note, theme, width);
        // Unless this is the last note, keep a line for the count of those that do not fit.
        let is_last = k + 1 == notes.len();
        let fits = lines.len() + of_note.len() + usize::from(!is_last) <= n_lines;
        if fits {
            lines.extend(of_note);
            continue;
        }
        // Of the worst note, show as much as there is room for.
        if k == 0 {
            lines.extend(of_note);
        }
        lines.truncate(n_lines.saturating_sub(1));
        let more = if k == 0 { "there is more".into() } else { format!("and {} more", notes.len() - k) };
        lines.push(Line::styled(format!(" {more}: a taller window shows all"), theme.faint()));
        break;
    }
    lines.truncate(n_lines);
    lines
}

fn lines_of(note: &Note, theme: Theme, width: usize) -> Vec<Line<'static>> {
    let indent = 1;
    let text = format!("{}: {}", note.word, note.text);
    let lines = wrapped(&text, width.saturating_sub(indent + 1).max(20));
    let mut styled = Vec::new();
    for (k, line) in lines.into_iter().enumerate() {
        match line.strip_prefix(note.word).filter(|_| k == 0) {
            Some(rest) => styled.push(Line::from(vec![
                Span::raw(" ".repeat(indent)),
                Span::styled(note.word, theme.word(note.level)),
                Span::raw(rest.to_string()),
            ])),
            None => styled.push(Line::raw(format!("{}{line}", " ".repeat(indent + 2)))),
        }
    }
    styled
}

/// The error against the truth, where there is one: as much as fits.
pub fn truth_text(model: &Model, width: usize) -> Option<String> {
    let error = model.truth_error()?;
    let (mut parts, has) = (Vec::new(), model.parts());
    if has.contains(&Part::Translation) {
        parts.push(format!("{} m/s", magnitude(error.velocity_m_s)));
        parts.push(format!("{} N", magnitude(error.force_n)));
        parts.push(format!("{} m", magnitude(error.position_m)));
    }
    if has.contains(&Part::Rotation) {
        parts.push(format!("{}°", magnitude(error.attitude_rad.to_degrees())));
        parts.push(format!("{}°/s", magnitude(error.angular_velocity_rad_s.to_degrees())));
        parts.push(format!("{} N·m", magnitude(error.torque_n_m)));
    }
    let text = |parts: &[String]| format!("off the truth: {}", parts.join(", "));
    while text(&parts).chars().count() > width && parts.len() > 1 {
        parts.pop();
    }
    Some(text(&parts))
}

/// The vectors of these parts, in the order in which they are shown.
pub fn vectors_of<'a>(model: &'a Model, parts: &[Part]) -> Vec<&'a Vector> {
    model.vectors.iter().filter(|vector| parts.contains(&vector.part)).collect()
}

/// Whether a deviation is known of what these parts show.
pub fn has_deviations(model: &Model, parts: &[Part]) -> bool {
    vectors_of(model, parts).iter().any(|vector| (0..3).any(|k| vector.deviation(k).is_some()))
}

/// A component's deviation behind its value; nothing where it is unknown.
pub fn deviation_text(vector: &Vector, component: usize) -> String {
    vector.deviation(component).map_or(String::new(), |value| format!(" ±{}", deviation(value)))
}

/// Columns of the state in numbers with their deviations.
const STATE_COLUMNS: usize = 75;

/// State and learned force in numbers alone, with their deviations where they are known and there is room.
pub fn state_lines(model: &Model, parts: &[Part], width: usize) -> Vec<Line<'static>> {
    let with_deviations = width >= STATE_COLUMNS && has_deviations(model, parts);
    let mut lines = Vec::new();
    for vector in vectors_of(model, parts) {
        for (row, axes) in vector.axes[..vector.n_shown()].chunks(3).enumerate() {
            let mut text = format!(" {:LABEL$}", if row == 0 { vector.name } else { "" });
            for (k, axis) in axes.iter().enumerate() {
                let component = 3 * row + k;
                text += &format!("{axis:>3} {:>9}", number(vector.now[component], vector.decimals()));
                if with_deviations {
                    text += &format!("{:<7}", deviation_text(vector, component));
                }
            }
            lines.push(Line::raw(text.trim_end().to_owned()));
        }
    }
    lines
}

/// How far each channel can be trusted: a heading, and a line each. A narrow view shows either the norm or the solver's
/// error: the latter if a solver is not exact; and either the bound or the NIS: the latter if a law has one.
pub fn trust_lines(model: &Model, parts: &[Part], theme: Theme, width: usize) -> Vec<Line<'static>> {
    let units: Vec<_> = parts.iter().filter_map(|part| part.unit()).collect();
    let channels =
        || model.estimate.iter().flat_map(|estimate| parts.iter().map(|part| part.channel(estimate)));
    let is_exact = channels().all(|channel| channel.solver_error == 0.0);
    let has_nis = channels().any(|channel| channel.nis != 0.0);
    let is_wide = width >= TRUST_COLUMNS;
    let with_norm = |column: String| if is_wide || is_exact { column } else { String::new() };
    let with_solver = |column: String| if is_wide || !is_exact { column } else { String::new() };
    let with_bound = |column: String| if is_wide || !has_nis { column } else { String::new() };
    let with_nis = |column: String| if is_wide || has_nis { column } else { String::new() };
    let heading = format!(
        "{:<w$}{:>8}{:>8}{}{}{:>8}{:>10}{}{}{:>7}",
        format!(" TRUST {}", units.join(", ")),
        "error",
        "zone",
        with_bound(format!("{:>8}", "bound")),
        with_nis(format!("{:>8}", "NIS")),
        "σ",
        "uncovered",
        with_norm(format!("{:>8}", "norm")),
        with_solver(format!("{:>8}", "solver")),
        "age",
        w = LABEL + 9
    );
    let mut lines = vec![Line::styled(heading, theme.title())];
    let Some(estimate) = &model.estimate else { return lines };
    for &part in parts {
        let channel = part.channel(estimate);
        let coasts = estimate.status & part.coasting_bit() != 0;
        let (does, level) = match () {
            () if estimate.status & part.stale_bit() != 0 => ("stale", Level::Alarm),
            () if coasts => ("predicts", Level::Caution),
            () if estimate.status & status_bits::FROZEN != 0 => ("frozen", Level::Info),
            () if estimate.status & status_bits::ON_GROUND != 0 => ("grounded", Level::Info),
            () if channel.activation > 0.0 => ("learns", Level::Good),
            () => ("within", Level::Good),
        };
        let zone =
            model.status.map_or("–".into(), |status| magnitude(status.dead_zone_width[part as usize]));
        let nis = if channel.nis == 0.0 { "–".into() } else { magnitude(channel.nis) };
        // The error of a channel that coasts is unknown.
        let known = |text: String| if coasts { "–".into() } else { text };
        let solver =
            if channel.solver_error == 0.0 { "exact".into() } else { magnitude(channel.solver_error) };
        lines.push(Line::from(vec![
            Span::raw(format!(" {:<w$}", part.name(), w = LABEL - 1)),
            Span::styled(format!("{does:<9}"), theme.word(level)),
            Span::raw(format!(
                "{:>8}{zone:>8}{}{}{:>8}{:>10}{}{}{:>7}",
                known(magnitude(channel.output_error)),
                with_bound(format!("{:>8}", known(magnitude(channel.error_bound)))),
                with_nis(format!("{nis:>8}")),
                magnitude(channel.activation),
                known(format!("{:.0} %", 100.0 * channel.power_function)),
                with_norm(format!("{:>8}", magnitude(channel.native_norm))),
                with_solver(format!("{solver:>8}")),
                if channel.output_age_s.is_finite() {
                    duration(channel.output_age_s)
                } else {
                    "never".into()
                },
            )),
        ]));
    }
    lines
}

/// Samples: used, lost, rejected, held back.
pub fn sample_lines(model: &Model, theme: Theme, width: usize, n_lines: usize) -> Vec<Line<'static>> {
    let title = Span::styled(format!("{:<LABEL$}", " SAMPLES"), theme.title());
    let Some(status) = &model.status else { return vec![Line::from(title)] };
    let rate = model.growth_per_s(|status| status.counters.samples_accepted);
    let rate = rate.map_or(String::new(), |per_s| format!(" ({per_s:.0}/s)"));
    let by_part = |counts: [u64; 3]| {
        let total: u64 = counts.iter().sum();
        let parts = Part::ALL.into_iter().filter(|&part| counts[part as usize] > 0);
        let parts: Vec<_> = parts.map(|part| part.output()).collect();
        match parts.is_empty() {
            true => "0".into(),
            false => format!("{total} ({})", parts.join(", ")),
        }
    };
    let facts = format!(
        "used {}{rate}, lost {}, rejected {}, held back {}, stuck {}",
        status.counters.samples_accepted,
        status.counters.samples_lost,
        status.counters.samples_rejected_total(),
        by_part(status.counters.outputs_held_back),
        by_part(status.counters.outputs_stuck),
    );
    let rejections: Vec<_> =
        model.rejections().into_iter().map(|(reason, count)| format!("{count} {}", reason.words())).collect();
    let source = match (status.source_pid, status.newest_sample_age_ns) {
        (0, u64::MAX) => "none yet".into(),
        (0, age_ns) => format!("source unknown, {} ago", duration_ns(age_ns)),
        (pid, age_ns) => format!("process {pid}, {} ago", duration_ns(age_ns)),
    };
    let rejections = match rejections.is_empty() {
        true => String::new(),
        false => format!("; rejected: {}", rejections.join(", ")),
    };
    let rows = status.sources().map(|source| {
        let sensor = if source.sensor == 0 { String::new() } else { format!(" sensor {}", source.sensor) };
        format!(
            "{}{sensor}: {:.0}/s, {} late, {} ago",
            source.pid,
            source.rate_hz().unwrap_or(0.0),
            duration_ns(source.delay_ns),
            duration_ns(source.age_ns)
        )
    });
    let rows: Vec<_> = rows.collect();
    let columns = width.saturating_sub(LABEL).max(20);
    let mut texts = wrapped(&facts, columns);
    match texts.len() {
        1 => texts.extend(wrapped(&format!("{source}{rejections}"), columns)),
        _ => texts = wrapped(&format!("{facts}; {source}{rejections}"), columns),
    }
    // One source is described above.
    if rows.len() > 1 {
        texts.extend(wrapped(&rows.join("; "), columns));
    }
    if texts.len() > n_lines {
        texts.truncate(n_lines);
        if let Some(last) = texts.last_mut() {
            *last = cut(&format!("{last} …"), columns);
        }
    }
    let mut lines = vec![Line::from(vec![title, Span::raw(texts.remove(0))])];
    lines.extend(texts.into_iter().map(|line| Line::raw(format!("{:LABEL$}{line}", ""))));
    lines
}

/// Latency summaries: a heading and four lines; with more quantiles where there is room.
pub fn latency_lines(model: &Model, theme: Theme, is_wide: bool) -> Vec<Line<'static>> {
    type Column = (&'static str, fn(&LatencySummary) -> u64);
    let columns: &[Column] = if is_wide {
        &[
            ("p50", |l| l.p50),
            ("p90", |l| l.p90),
            ("p99", |l| l.p99),
            ("p99.9", |l| l.p999),
            ("max", |l| l.max),
        ]
    } else {
        &[("p50", |l| l.p50), ("p99", |l| l.p99), ("max", |l| l.max)]
    };
    let mut heading = format!("{:<17}", " LATENCY µs");
    for (name, _) in columns {
        heading += &format!("{name:>8}");
    }
    if is_wide {
        heading += &format!("{:>11}", "count");
    }
    let mut lines = vec![Line::styled(heading, theme.title())];
    let Some(status) = &model.status else { return lines };
    for (name, summary) in [
        ("wake-up lateness", &status.wake_up_lateness_ns),
        ("step", &status.step_ns),
        ("sample age", &status.input_age_ns),
        ("sample to output", &status.source_to_publish_ns),
    ] {
        let mut line = format!(" {name:<16}");
        for (_, quantile) in columns {
            let text = if summary.count == 0 { "–".into() } else { micros(quantile(summary)) };
            line += &format!("{text:>8}");
        }
        if is_wide {
            line += &format!("{:>11}", summary.count);
        }
        lines.push(Line::raw(line));
    }
    lines
}

/// The counters that have places of their own in these sections.
const SHOWN: [&str; 15] = [
    "ticks",
    "deadline misses",
    "samples accepted",
    "samples lost",
    "samples rejected",
    "outputs held back",
    "outputs stuck",
    "ticks coasting",
    "ticks clamped",
    "ticks predict only",
    "ticks invalid",
    "state resets",
    "source changes",
    "commands",
    "ticks not recorded",
];

/// Facts about the service (real time, snapshots, record): a heading and lines, the most important first.
pub fn service_lines(model: &Model, theme: Theme) -> Vec<Line<'static>> {
    let mut lines = vec![Line::styled("SERVICE", theme.title())];
    let Some(status) = &model.status else { return lines };
    let mut fact = |text: String| lines.push(Line::raw(text));
    let granted = real_time::words(status.real_time_granted).join(", ");
    let refused = real_time::words(status.real_time_requested & !status.real_time_granted).join(", ");
    fact(match refused.is_empty() {
        true => format!("real time granted {granted}"),
        false => format!("real time REFUSED {refused}; granted {granted}"),
    });
    let (missed, most) = (status.counters.deadline_misses, status.most_late_ticks_in_a_row);
    fact(match status.late_ticks_in_a_row {
        0 => format!("deadlines {missed} missed, {most} in a row"),
        late => format!("deadlines LATE now, {late} in a row; {missed} missed"),
    });
    let newest = match status.snapshot_stamp_ns {
        0 => "none yet".into(),
        stamp_ns => format!("{} ago", duration_ns(status.stamp_ns.saturating_sub(stamp_ns))),
    };
    fact(match status.snapshots_failed {
        0 => format!("snapshot  {newest}; {} saved", status.snapshots_saved),
        failed => format!("snapshot  {failed} FAILED; {newest}; {} saved", status.snapshots_saved),
    });
    fact(match (status.ticks_recorded, status.counters.ticks_not_recorded) {
        (0, 0) => "record    none".into(),
        (written, 0) => format!("record    {written} ticks"),
        (written, lost) => format!("record    {written} ticks, {lost} LEFT OUT"),
    });
    fact(format!(
        "learning  {}; held at its limit for {} ticks",
        if status.adaptation_frozen == 1 { "frozen" } else { "on" },
        status.counters.ticks_clamped
    ));
    fact(format!(
        "ticks     {} coasting, {} predict-only, {} invalid",
        status.counters.ticks_coasting, status.counters.ticks_predict_only, status.counters.ticks_invalid
    ));
    fact(format!("resets    of the state by itself: {}", status.counters.state_resets));
    let began = match status.snapshot_restored {
        restored::LEARNED => "with what was learned before",
        restored::LEARNED_AND_STATE => "with state and what was learned before",
        _ => "with nothing learned",
    };
    fact(format!("began     {began}"));
    fact(format!(
        "source    changes {}, commands {}",
        status.counters.source_changes, status.counters.commands
    ));
    // The counters that no other line shows, once they are not zero.
    for (name, text) in
        status.counters.lines().filter(|(name, text)| text != "0" && !SHOWN.contains(&name.as_str()))
    {
        fact(format!("{name:<9} {text}"));
    }
    lines
}

/// The whole status as plain text.
pub fn text(model: &Model, now: Now, width: usize) -> String {
    let theme = Theme { is_coloured: false };
    let parts = model.parts();
    let mut lines = vec![heading(model, theme, width), verdict_line(model, now, theme, width)];
    lines.extend(note_lines(model, now, theme, width, 40));
    lines.push(Line::raw(""));
    lines.push(Line::raw(format!(" STATE  {}", truth_text(model, width).unwrap_or_default())));
    lines.extend(state_lines(model, &parts, width));
    for section in [
        trust_lines(model, &parts, theme, width),
        sample_lines(model, theme, width, 9),
        latency_lines(model, theme, true),
    ] {
        lines.push(Line::raw(""));
        lines.extend(section);
    }
    lines.push(Line::raw(""));
    lines.extend(service_lines(model, theme).into_iter().map(|line| Line::raw(format!(" {line}"))));
    let lines = lines.iter().map(|line| line.to_string().trim_end().to_string());
    lines.collect::<Vec<_>>().join("\n")
}
