//! What holds for every sample, every configuration and every name, tried with random ones.

use daemon::config::{
    Config, ConfigFile, DeadZoneName, GyroscopicTorqueName, InputConfig, KernelName, LengthScaleConfig,
    SolverConfig, SolverName, SolverOptions, SourcePolicy, SymmetricMatrix, Trigger,
};
use daemon::gate::Gate;
use proptest::prelude::*;
use shared_types::{Domain, Measurement};
use std::collections::HashSet;
use std::path::Path;

/// Runs are repeatable, and leave no files.
fn settings(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// What befalls a sample on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fate {
    Arrives,
    Lost,
    Damaged,
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![4 => Just(Fate::Arrives), 1 => Just(Fate::Lost), 1 => Just(Fate::Damaged)]
}

proptest! {
    #![proptest_config(settings(256))]

    #[test]
    fn every_sample_is_accepted_rejected_or_lost_exactly_once(fates in prop::collection::vec(fate(), 1..200)) {
        let mut gate = Gate::new(InputConfig::default(), true);
        let (mut accepted, mut rejected, mut lost) = (0, 0, 0);
        let period_ns = 5_000_000;
        for (sequence, fate) in (0..).zip(&fates) {
            let stamp_ns = 1_000_000_000_000 + sequence * period_ns;
            let speed = if *fate == Fate::Damaged { f64::NAN } else { 1.0 };
            let sample = Measurement::at(stamp_ns, sequence).with_velocity_m_s([speed, 0.0, 0.0]);
            if *fate == Fate::Lost {
                continue;
            }
            match gate.judge(&sample, 1, stamp_ns) {
                Ok(sample) => {
                    prop_assert_eq!(*fate, Fate::Arrives);
                    accepted += 1;
                    lost += sample.lost;
                }
                Err(_) => rejected += 1,
            }
        }
        // What was lost shows with the next accepted sample of a stream that has begun.
        let first = fates.iter().position(|fate| *fate == Fate::Arrives);
        let last = fates.iter().rposition(|fate| *fate == Fate::Arrives);
        let count = |fates: &[Fate], fate| fates.iter().filter(|f| **f == fate).count() as u64;
        prop_assert_eq!(accepted, count(&fates, Fate::Arrives));
        prop_assert_eq!(rejected, count(&fates, Fate::Damaged));
        let between = first.zip(last).map_or(0, |(first, last)| count(&fates[first..=last], Fate::Lost));
        // A silence longer than takeover_after_s is a new start, and no gap is claimed.
        let most_silent = fates.split(|fate| *fate == Fate::Arrives).map(<[Fate]>::len).max().unwrap_or(0);
        if (most_silent as u64 + 1) * period_ns < 200_000_000 {
            prop_assert_eq!(lost, between);
        }
    }

    #[test]
    fn no_sample_is_accepted_that_is_not_newer_than_the_last(
        policy in prop_oneof![Just(SourcePolicy::First), Just(SourcePolicy::Newest)],
        check_clock: bool,
        samples in prop::collection::vec((-400_i64..400, -20_000_i64..20_000, any::<u8>(), 0_u128..3, -10_i64..400), 1..100),
    ) {
        let mut gate = Gate::new(InputConfig { source: policy, ..InputConfig::default() }, check_clock);
        let mut now_ns = 1_000_000_000_000_u64;
        let mut newest_ns = 0;
        for (behind_ms, jump_ms, jumps, source, later_ms) in samples {
            now_ns = now_ns.saturating_add_signed(later_ms * 1_000_000);
            let distance_ms = if jumps < 64 { jump_ms } else { behind_ms };
            let stamp_ns = now_ns.saturating_add_signed(distance_ms * 1_000_000);
            let sequence = gate.newest_sequence().unwrap_or(0).saturating_add_signed(i64::from(jumps % 8) - 2);
            let sample = Measurement::at(stamp_ns, sequence).with_velocity_m_s([1.0, 0.0, 0.0]);
            if let Ok(accepted) = gate.judge(&sample, source, now_ns) {
                prop_assert!(stamp_ns > newest_ns || (accepted.new_time && !check_clock));
                newest_ns = stamp_ns;
            }
            prop_assert_eq!(gate.newest_stamp_ns().unwrap_or(0), newest_ns);
        }
    }

    #[test]
    fn a_printed_configuration_reads_back_as_itself(
        config in configuration(),
    ) {
        let mut file = ConfigFile::preset("rigid-body").unwrap();
        file.config = config;
        let printed = file.commented_toml();
        let again = ConfigFile::parse("printed".into(), printed.clone());
        prop_assert_eq!(&again.unwrap().config, &file.config, "{}", printed);
        let lines: Vec<_> = printed.lines().collect();
        for (above, line) in lines.iter().zip(&lines[1..]) {
            let is_key = line.contains(" = ") && !line.starts_with('#') && !line.starts_with(' ');
            prop_assert!(!is_key || above.starts_with("# "), "no comment above: {}\n{}", line, printed);
        }
    }

    #[test]
    fn no_domain_owns_the_segments_of_another(names in prop::collection::hash_set("[a-zA-Z0-9_.~/ -]{1,30}", 1..8)) {
        let domains: Vec<_> =
            names.iter().filter_map(|name| Domain::at(Path::new(&format!("/tmp/{name}"))).ok()).collect();
        let roots: HashSet<_> = domains.iter().map(Domain::root).collect();
        prop_assert_eq!(roots.len(), domains.len());
        for a in &domains {
            prop_assert!(a.root().as_os_str().len() + a.prefix().len() <= 60);
            for b in domains.iter().filter(|b| b.root() != a.root()) {
                prop_assert!(!a.prefix().starts_with(b.prefix()), "{:?} {:?}", a, b);
            }
        }
    }
}

/// A configuration of any legal shape; its numbers need not make a stable design.
fn configuration() -> impl Strategy<Value = Config> {
    let number = prop_oneof![1e-9..1e9_f64, Just(0.1), Just(1.0), Just(1e-300), Just(1e300)];
    let matrix = prop_oneof![
        number.clone().prop_map(SymmetricMatrix::Scalar),
        prop::array::uniform3(number.clone()).prop_map(SymmetricMatrix::Diagonal),
        prop::array::uniform3(prop::array::uniform3(number.clone())).prop_map(SymmetricMatrix::Full),
    ];
    let scale = prop_oneof![
        number.clone().prop_map(LengthScaleConfig::Isotropic),
        prop::collection::vec(number.clone(), 1..4).prop_map(LengthScaleConfig::PerAxis),
    ];
    let kernel = prop_oneof![
        (0..99_usize).prop_map(KernelName::SobolevMatern),
        Just(KernelName::Gaussian),
        Just(KernelName::WendlandC2),
        Just(KernelName::WendlandC4),
    ];
    let kind = prop_oneof![Just(SolverName::Auto), Just(SolverName::Dense), Just(SolverName::Local)];
    let solver = prop_oneof![
        kind.clone().prop_map(SolverConfig::Name),
        (kind, prop::option::of(0..20_usize), number.clone(), number.clone()).prop_map(
            |(kind, block, accuracy, truncation)| {
                SolverConfig::Options(SolverOptions { kind, block, accuracy, truncation })
            }
        ),
    ];
    let point = || prop::array::uniform3(-1e3..1e3_f64);
    let zone =
        prop_oneof![Just(DeadZoneName::Saturated), Just(DeadZoneName::Quadratic), Just(DeadZoneName::Step)];
    let channel =
        (matrix, scale, kernel, solver, zone, prop::option::of(prop::collection::vec(point(), 1..4)));
    let service =
        (number.clone(), any::<bool>(), prop::option::of(point()), prop::option::of(number), 0..3_u8);
    (service, channel, point()).prop_map(|(service, channel, gravity)| {
        let (size, flag, initial, rate, tables) = service;
        let (matrix, scale, kernel, solver, zone, listed) = channel;
        let mut config = ConfigFile::preset("rigid-body").unwrap().config;
        config.rate_hz = size;
        config.trigger = if flag { Trigger::Sample } else { Trigger::Timer };
        config.initial.position_m = initial;
        config.input.max_state = size;
        config.input.source = if flag { SourcePolicy::First } else { SourcePolicy::Newest };
        if let Some(t) = &mut config.translation {
            (t.mass_kg, t.gravity_m_s2, t.sample_rate_hz) = (size, gravity, rate);
            (t.adaptation_rate_kg_s2, t.length_scale_m_s) = (matrix, scale.clone());
            (t.kernel, t.solver, t.dead_zone) = (kernel, solver, zone);
            if let Some(listed) = &listed {
                t.centers_listed_m_s = Some(listed.clone());
                (t.centers_lower_m_s, t.centers_upper_m_s, t.centers_per_axis) = (None, None, None);
            }
        }
        if let Some(r) = &mut config.rotation {
            (r.inertia_kg_m2, r.length_scale_rad_s, r.kernel, r.solver) = (matrix, scale, kernel, solver);
            r.gyroscopic_torque =
                if flag { GyroscopicTorqueName::Learned } else { GyroscopicTorqueName::Feedforward };
            r.centers_listed_rad_s = listed;
        }
        match tables {
            0 => config.rotation = None,
            1 => config.translation = None,
            _ => config.linear = ConfigFile::preset("linear").unwrap().config.linear,
        }
        config
    })
}
