//! The contents of the screen, for made-up statuses and many sizes.

use monitor::link::News;
use monitor::model::Model;
use monitor::view::draw::draw;
use monitor::view::notes::Now;
use monitor::view::state::View;
use monitor::view::status_words::Level;
use monitor::view::theme::Theme;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::style::Color;
use shared_types::payload::{Counters, real_time, restored, status_bits as bits};
use shared_types::{Channel, Estimate, LatencySummary, Status, Truth};

const S: u64 = 1_000_000_000;
const START_NS: u64 = 5_000 * S;
const NOW: Now = Now { monotonic_ns: START_NS + 60 * S, unix_s: 1_700_000_000 };

const PLAIN: Theme = Theme { is_coloured: false };

fn drawn_with(model: &Model, view: &View, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, model, view, NOW)).unwrap();
    terminal.backend().buffer().clone()
}

fn text_of(buffer: &Buffer) -> String {
    let width = usize::from(buffer.area.width.max(1));
    let cells: Vec<_> = buffer.content().iter().map(|cell| cell.symbol()).collect();
    let lines: Vec<_> = cells.chunks(width).map(|line| line.concat().trim_end().to_string()).collect();
    lines.join("\n")
}

fn drawn(model: &Model, width: u16, height: u16) -> String {
    text_of(&drawn_with(model, &View::new(PLAIN), width, height))
}

fn assert_shows(text: &str, needed: &[&str]) {
    for needed in needed {
        assert!(text.contains(needed), "lacks '{needed}':\n{text}");
    }
}

fn channel(output_error: f64) -> Channel {
    Channel {
        output_error,
        activation: 0.25,
        power_function: 0.09,
        native_norm: 3.21,
        solver_error: 0.0,
        error_bound: 0.05,
        output_age_s: 0.004,
        nis: 0.0,
    }
}

/// A multicopter whose velocity along x rises from −30 to 30 m/s within the minute.
fn body(t_s: f64) -> Estimate {
    Estimate {
        sequence: (200.0 * t_s) as u64,
        publish_stamp_ns: START_NS + (t_s * 1e9) as u64,
        stamp_ns: START_NS + (t_s * 1e9) as u64,
        status: bits::TRACKING | bits::ADAPTING,
        position_m: [12.345, -3.21, -110.0],
        velocity_m_s: [t_s - 30.0, 0.5, -0.25],
        attitude_wxyz: [1.0, 0.0, 0.0, 0.0],
        euler_rad: [0.1, -0.2, 3.0],
        angular_velocity_rad_s: [0.01, 0.02, 0.03],
        matched_force_n: [-4.56, 0.0, 9.87],
        matched_torque_n_m: [0.011, 0.022, 0.033],
        translation: channel(0.0123),
        rotation: channel(0.0045),
        ..unsure()
    }
}

/// Without a known deviation.
fn unsure() -> Estimate {
    let unknown = [f64::INFINITY; 3];
    Estimate {
        position_std_m: unknown,
        velocity_std_m_s: unknown,
        attitude_std_rad: unknown,
        angular_velocity_std_rad_s: unknown,
        matched_force_std_n: unknown,
        matched_torque_std_n_m: unknown,
        ..Estimate::default()
    }
}

/// The same with the deviations and NIS of a law that knows them.
fn sure(t_s: f64) -> Estimate {
    let mut estimate = Estimate {
        position_std_m: [1.25, 0.35, 123.0],
        velocity_std_m_s: [0.0123, 0.0234, 4e-4],
        attitude_std_rad: [0.001, 0.002, 0.003],
        angular_velocity_std_rad_s: [0.01, 0.02, 0.03],
        matched_force_std_n: [0.31, 0.52, 12.0],
        matched_torque_std_n_m: [0.004, 0.005, 0.006],
        ..body(t_s)
    };
    (estimate.translation.nis, estimate.rotation.nis) = (1.07, 0.815);
    estimate
}

/// A linear plant of five states and two inputs.
fn plant(t_s: f64) -> Estimate {
    let mut estimate = Estimate { linear: channel(0.003), ..body(t_s) };
    (estimate.translation, estimate.rotation) = Default::default();
    estimate.state[..5].copy_from_slice(&[1.5, -2.5, 3.5, 0.0, 5.5]);
    estimate.matched_input[..2].copy_from_slice(&[0.75, -0.85]);
    estimate
}

fn status(t_s: f64) -> Status {
    let latency =
        LatencySummary { count: 12_000, p50: 20_100, p90: 30_000, p99: 51_200, p999: 70_000, max: 99_900 };
    Status {
        stamp_ns: START_NS + (t_s * 1e9) as u64,
        start_stamp_ns: START_NS - 3_600 * S,
        rate_millihertz: 200_000,
        dead_zone_width: [0.0211, 0.0321, 0.0],
        counters: Counters {
            ticks: 732_000,
            samples_accepted: (t_s * 200.0) as u64,
            samples_lost: 12,
            samples_rejected: [1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0],
            ..Counters::default()
        },
        newest_sample_age_ns: 4_000_000,
        source_pid: 4711,
        real_time_requested: real_time::PRIORITY | real_time::PUNCTUAL_TIMERS,
        real_time_granted: real_time::PUNCTUAL_TIMERS,
        snapshot_restored: restored::LEARNED,
        snapshots_saved: 42,
        snapshot_stamp_ns: START_NS + 55 * S,
        ticks_recorded: 700_000,
        wake_up_lateness_ns: latency,
        step_ns: latency,
        input_age_ns: latency,
        source_to_publish_ns: latency,
        ..Status::default()
    }
}

fn heard(estimate: fn(f64) -> Estimate) -> Model {
    let mut model = Model::new("vehicle");
    for tick in 0..=600 {
        let t_s = f64::from(tick) * 0.1;
        model.note(News::Estimate(estimate(t_s)));
        model.note(News::Status(status(t_s)));
    }
    model
}

fn both(t_s: f64) -> Estimate {
    let body = body(t_s);
    Estimate { translation: body.translation, rotation: body.rotation, ..plant(t_s) }
}

const ESSENTIAL: [&str; 26] = [
    "vehicle",
    "200 Hz",
    "TRACKING",
    "estimate 0 ms old",
    "12.345",
    "-110.000",
    "30.000",
    "171.887",
    "1.719",
    "-4.560",
    "0.033",
    "translation",
    "rotation",
    "learns",
    "0.0123",
    "0.0211",
    "0.0321",
    "0.0500",
    "9 %",
    "used 12000 (200/s), lost 12, rejected 3",
    "process 4711",
    "1 not finite",
    "20.1",
    "REFUSED priority",
    "snapshot  5.0 s ago; 42 saved",
    "record    700000 ticks",
];

#[test]
fn everything_essential_stands_on_80_by_24() {
    let text = drawn(&heard(body), 80, 24);
    assert_shows(&text, &ESSENTIAL);
    assert_shows(&text, &["q quit", "? help"]);
}

#[test]
fn more_room_shows_more() {
    for (width, height) in [(120, 40), (200, 50)] {
        let text = drawn(&heard(body), width, height);
        assert_shows(&text, &ESSENTIAL);
        assert_shows(&text, &["p99.9", "with what was learned before"]);
        let used = text.lines().filter(|line| !line.is_empty()).count();
        assert!(used > usize::from(height) * 3 / 4, "{used} of {height} lines in use:\n{text}");
    }
}

#[test]
fn a_small_terminal_shows_what_matters_most_and_says_that_there_is_more() {
    let mut model = heard(body);
    model.note(News::Estimate(Estimate { status: bits::STALE, ..body(60.05) }));
    let text = drawn(&model, 60, 15);
    assert_shows(
        &text,
        &[
            "DO NOT FLY ON THIS",
            "stale: no good sample",
            "velocity m/s",
            "30.050",
            "learned N",
            "80×24 shows all",
        ],
    );
    // What does not fit into a line is marked.
    let error = text.lines().find(|line| line.contains("TRUST"));
    assert!(error.is_none_or(|line| line.ends_with('…')), "{text}");
    assert_shows(&drawn(&model, 100, 20), &["TRUST m/s, rad/s", "learns", "SAMPLES", "80×24 shows all"]);
    assert_shows(&drawn(&model, 30, 6), &["DO NOT FLY ON THIS", "stale:"]);
    assert!(!drawn(&model, 80, 24).contains("shows all"));
}

#[test]
fn deviations_and_nis_stand_beside_the_values_on_80_by_24() {
    for (width, height) in [(80, 24), (100, 30), (200, 50)] {
        let text = drawn(&heard(sure), width, height);
        let missing_bound = if width < 96 { Some("0.0500") } else { None };
        let essential: Vec<_> = ESSENTIAL.into_iter().filter(|text| Some(*text) != missing_bound).collect();
        assert_shows(&text, &essential);
        let deviations =
            ["12.345 ±1.2", "-3.210 ±0.35", "-110.000 ±123", "±0.012", "±4e-4", "±0.057", "±12", "±0.006"];
        assert_shows(&text, &deviations);
        assert_shows(&text, &["NIS", "1.070", "0.815"]);
    }
    // A smaller one shows the values alone.
    let small = drawn(&heard(sure), 60, 15);
    assert!(small.contains("30.000") && !small.contains('±'), "{small}");
    let unknown = drawn(&heard(body), 80, 24);
    assert!(!unknown.contains('±') && !unknown.contains("NIS"), "{unknown}");
}

#[test]
fn a_channel_that_is_silent_is_named_and_the_other_goes_on() {
    let mut model = heard(body);
    let mut late = body(60.05);
    late.status = bits::STALE | bits::STALE_ROTATION | bits::COASTING_ROTATION | bits::ON_GROUND;
    late.rotation.output_age_s = 0.8;
    model.note(News::Estimate(late));
    let text = drawn(&model, 80, 24);
    assert_shows(
        &text,
        &[
            "DO NOT FLY ON THIS: no angular velocity comes",
            "stale-rotation: no angular velocity for 0.8 s; does its sensor work?",
            "grounded",
            "on-ground:",
        ],
    );
    let of_rotation = text.lines().find(|line| line.starts_with(" rotation")).unwrap();
    assert!(of_rotation.contains("stale") && !text.contains("coasting-rotation"), "{text}");
    // All silent: said once.
    late.publish_stamp_ns += S;
    late.status |= bits::STALE_TRANSLATION;
    model.note(News::Estimate(late));
    let text = drawn(&model, 80, 24);
    assert_shows(&text, &["DO NOT FLY ON THIS: no sample comes", "stale: no good sample for 4 ms"]);
    assert!(!text.contains("stale-"), "{text}");
}

#[test]
fn the_local_solvers_error_takes_the_norms_place_where_there_is_no_room_for_both() {
    let local = |t_s: f64| {
        let mut estimate = body(t_s);
        estimate.translation.solver_error = 0.0777;
        estimate
    };
    let [exact, narrow, wide] = [(heard(body), 80), (heard(local), 80), (heard(local), 96)]
        .map(|(model, width)| drawn(&model, width, 24));
    assert_shows(&exact, &["zone", "norm", "3.210"]);
    assert!(!exact.contains("solver"), "{exact}");
    assert_shows(&narrow, &["zone", "solver", "0.0777", "exact"]);
    assert!(!narrow.contains("norm"), "{narrow}");
    assert_shows(&wide, &["norm", "3.210", "solver", "0.0777"]);
}

#[test]
fn latencies_are_counted_into_a_histogram() {
    let mut model = Model::new("vehicle");
    // 100 samples at 20 µs and four at 3 ms; estimates without a new sample do not count.
    for tick in 0..=208_u64 {
        let at_ns = START_NS + tick * 5_000_000;
        let sample = tick / 2;
        let latency_ns = if sample.is_multiple_of(26) { 3_000_000 } else { 20_000 };
        let source_stamp_ns = START_NS + sample * 10_000_000 - latency_ns;
        model.note(News::Estimate(Estimate { publish_stamp_ns: at_ns, source_stamp_ns, ..body(0.0) }));
    }
    for tick in 0..3 {
        model.note(News::Status(status(f64::from(tick))));
    }
    let counts = model.sample_to_output.counts;
    assert_eq!((counts[10], counts[27], counts.iter().sum::<u64>()), (100, 4, 104), "{counts:?}");
    let text = drawn(&model, 200, 50);
    assert_shows(&text, &["SAMPLE TO OUTPUT, how often", "1µs     10µs    100µs   1ms", "σ until now"]);
}

#[test]
fn any_size_is_drawn() {
    let strange = |t_s: f64| {
        let mut estimate = both(t_s);
        estimate.position_m = [f64::NAN, f64::INFINITY, -1e300];
        estimate.velocity_m_s = [1e308, -1e308, 1e-308];
        estimate.velocity_std_m_s = [1e308, 0.0, 1e-308];
        estimate.translation.error_bound = f64::INFINITY;
        estimate.translation.output_age_s = f64::INFINITY;
        estimate.rotation.output_error = f64::NAN;
        estimate.status = u64::MAX;
        estimate
    };
    let mut away = heard(body);
    away.note(News::Away { since_ns: START_NS, why: "no process runs it; start it: daemon run".into() });
    for model in [Model::new("v"), heard(body), heard(sure), heard(plant), heard(both), heard(strange), away]
    {
        for height in [0, 1, 2, 3, 8, 15, 23, 24, 34, 55, 120] {
            for width in [0, 1, 2, 3, 14, 15, 30, 60, 79, 80, 110, 200, 300] {
                let mut view = View::new(PLAIN);
                drawn_with(&model, &view, width, height);
                (view.shows_help, view.asks_reset) = (true, true);
                drawn_with(&model, &view, width, height);
            }
        }
    }
}

#[test]
fn a_linear_plant_shows_as_many_components_as_it_uses() {
    let text = drawn(&heard(plant), 80, 24);
    assert_shows(&text, &["state", "learned f", "5.500", "0.750", "-0.850", "linear"]);
    assert_shows(&text, &["5   5.50000"]);
    assert!(!text.contains("6   0.00000") && !text.contains("position"), "{text}");
}

#[test]
fn a_service_that_comes_back_with_another_plant_shows_that_one() {
    let mut model = heard(body);
    model.note(News::Status(Status { start_stamp_ns: START_NS + 60 * S, ..status(60.1) }));
    model.note(News::Estimate(plant(60.2)));
    let text = drawn(&model, 80, 24);
    assert!(text.contains("learned f") && !text.contains("position"), "{text}");
    assert_shows(&text, &["restarts 1"]);
}

#[test]
fn parts_that_do_not_fit_together_take_turns() {
    let model = heard(both);
    let mut view = View::new(PLAIN);
    let page = |view: &View, height| text_of(&drawn_with(&model, view, 80, height));
    let first = page(&view, 24);
    assert!(
        first.contains("position") && !first.contains("learned f") && first.contains("tab next"),
        "{first}"
    );
    view.page = 1;
    let second = page(&view, 24);
    assert!(second.contains("learned f") && !second.contains("position"), "{second}");
    let whole = page(&view, 50);
    assert!(
        whole.contains("learned f") && whole.contains("position") && !whole.contains("tab next"),
        "{whole}"
    );
}

#[test]
fn a_rising_velocity_rises_in_its_picture() {
    let text = drawn(&heard(body), 200, 24);
    let line = text.lines().find(|line| line.contains("velocity m/s")).unwrap();
    let bars: Vec<_> = line.chars().filter(|c| ('▁'..='█').contains(c)).take(40).collect();
    assert!(bars.is_sorted() && bars[0] == '▁' && *bars.last().unwrap() > '▅', "{line}");
}

#[test]
fn the_worst_comes_first_and_what_does_not_fit_is_announced() {
    let mut model = heard(body);
    let mut late = body(60.05);
    late.status = bits::STALE | bits::COASTING_TRANSLATION | bits::CLAMPED | bits::HELD_BACK | bits::FROZEN;
    late.translation.output_age_s = 0.8;
    model.note(News::Estimate(late));
    let text = drawn(&model, 80, 24);
    assert_shows(
        &text,
        &["DO NOT FLY ON THIS", "stale: no good sample for 4 ms", "more: a taller window shows all"],
    );
    let text = drawn(&model, 120, 50);
    assert_shows(
        &text,
        &["coasting-translation: no velocity for 0.8 s: predicting", "clamped:", "held-back:", "frozen:"],
    );
}

#[test]
fn a_service_that_is_away_is_said_to_be_over_its_last_estimate() {
    let mut model = heard(body);
    model.note(News::Away {
        since_ns: NOW.monotonic_ns - 12 * S,
        why: "no process runs it; start it: daemon run".into(),
    });
    let text = drawn(&model, 80, 24);
    assert_shows(
        &text,
        &["the service is away since 22:13:08 UTC (12 s), waiting", "no process runs it", "12.345"],
    );
    model.note(News::Estimate(Estimate { publish_stamp_ns: NOW.monotonic_ns + 1, ..body(61.0) }));
    assert!(!drawn(&model, 80, 24).contains("away"));
}

#[test]
fn the_error_against_the_truth_is_taken_at_the_estimates_own_instant() {
    let mut model = Model::new("vehicle");
    let truth = |t_s: f64| Truth {
        stamp_ns: START_NS + (t_s * 1e9) as u64,
        // At 10 m/s along x: half a period off would be 0.05 m.
        position_m: [10.0 * t_s, 0.0, 0.0],
        attitude_wxyz: [1.0, 0.0, 0.0, 0.0],
        ..Truth::default()
    };
    for tick in 0..1000 {
        let t_s = f64::from(tick) * 0.01;
        model.note(News::Truth(truth(t_s)));
        let mut estimate = body(t_s + 0.005);
        estimate.position_m = [10.0 * (t_s + 0.005) + 0.003, 0.0, 0.0];
        model.note(News::Estimate(estimate));
    }
    let error = model.truth_error().unwrap();
    // Stamps are whole nanoseconds.
    assert!((error.position_m - 0.003).abs() < 1e-6, "{error:?}");
    assert!(error.attitude_rad < 1e-6, "{error:?}");
    assert_shows(&drawn(&model, 80, 24), &["off the truth: ", " 0.0030 m,"]);
}

#[test]
fn without_colours_there_are_none() {
    let mut model = heard(body);
    model.note(News::Estimate(Estimate { status: bits::STALE | bits::CLAMPED, ..body(60.05) }));
    let is_coloured = |is_coloured: bool| {
        let buffer = drawn_with(&model, &View::new(Theme { is_coloured }), 120, 40);
        buffer.content().iter().any(|cell| cell.fg != Color::Reset || cell.bg != Color::Reset)
    };
    assert!(is_coloured(true) && !is_coloured(false));
}

#[test]
fn a_picture_that_stands_still_tells_the_verdict_of_now() {
    let mut view = View::new(PLAIN);
    view.paused = Some((Level::Alarm, "DO NOT FLY ON THIS".into()));
    let text = text_of(&drawn_with(&heard(body), &view, 80, 24));
    assert_shows(&text, &["PAUSED, p goes on; now: DO NOT FLY ON THIS"]);
}
