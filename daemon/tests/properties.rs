//! Properties of every stream of samples and of every domain's name, tested with random ones.

use daemon::config::{InputConfig, SourcePolicy};
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
            match gate.judge(&sample, 1, &gate.in_order(&sample, stamp_ns)) {
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
        policy in prop_oneof![Just(SourcePolicy::All), Just(SourcePolicy::First), Just(SourcePolicy::Newest)],
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
            if let Ok(accepted) = gate.judge(&sample, source, &gate.in_order(&sample, now_ns)) {
                prop_assert!(stamp_ns > newest_ns || (accepted.new_time && !check_clock));
                newest_ns = stamp_ns;
            }
            prop_assert_eq!(gate.newest_stamp_ns().unwrap_or(0), newest_ns);
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
