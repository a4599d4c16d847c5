use super::*;
use crate::design::{DisturbanceBounds, GyroscopicTorque};
use crate::designs::body_channel;
use crate::law::dead_zone::DeadZone;
use crate::report::findings::Verdict;
use crate::space::centers::Centers;

fn paper(inertia: Matrix3<f64>, box_half: f64, zone: (DeadZoneShape, f64), noise: f64) -> ChannelDesign {
    let dead_zone = DeadZone::new(zone.0, zone.1, 0.01).unwrap();
    ChannelDesign {
        centers: Centers::lattice([-box_half; 3], [box_half; 3], [3; 3]).unwrap(),
        bounds: DisturbanceBounds { noise, ..DisturbanceBounds::default() },
        ..body_channel(inertia, Matrix3::identity(), dead_zone)
    }
}

fn translation() -> TranslationDesign {
    let noise = 0.008 * 6.0_f64.sqrt();
    TranslationDesign {
        channel: paper(Matrix3::identity() * 4.0, 1.0, (DeadZoneShape::Quadratic, 0.01), noise),
        known_force_n: nalgebra::Vector3::zeros(),
        velocity_error_to_position: 0.0,
        position_fix_gain_per_s: 0.0,
        position_fix_hold_s: 0.0,
    }
}

fn report_of(design: &TranslationDesign) -> DesignReport {
    DesignReport::of_translation(design, &design.channel.function().unwrap()).unwrap()
}

fn verdict(report: &DesignReport, condition: &str) -> Verdict {
    let findings = report.findings();
    findings.iter().find(|f| f.condition.starts_with(condition)).unwrap().verdict
}

/// By hand: P = 4I, Q = 2λP = 80 I, ‖PL‖ = 40, E₀ = 2 δ̄ 40/80 = δ̄.
#[test]
fn the_papers_translation_has_the_numbers_of_a_hand_calculation() {
    let report = report_of(&translation());
    assert!(report.controllable && !report.observable && !report.hurwitz && report.observable_hurwitz);
    assert_eq!(report.unobservable, ["position"]);
    let pair = report.lure.as_ref().unwrap();
    assert!((&pair.p - DMatrix::identity(3, 3) * 4.0).amax() < 1e-12);
    assert!((pair.lambda_min - 80.0).abs() < 1e-10 && (pair.pl_norm - 40.0).abs() < 1e-10);
    assert!((report.certificate.unwrap().e0() - 0.0195959).abs() < 1e-7);
    assert!((report.certificate.unwrap().d_n() - 0.0195959).abs() < 1e-7);
    assert!((report.sup_power_function.value - 0.443_724_775_3).abs() < 1e-8);
    assert!((report.gram_condition - 291.69).abs() < 0.02);
    assert!((report.value_at_zero - 2.467_401_1).abs() < 1e-7);
    assert_eq!(verdict(&report, "d > d_N"), Verdict::Fails);
    assert_eq!(verdict(&report, "(A, C)"), Verdict::Fails);
    assert_eq!(verdict(&report, "sampled law"), Verdict::Holds);
    assert_eq!(report.level_set_factor(), 1.0);
}

/// P = I, hence E₀ = 2 δ̄ λ 15 / (2 λ 0.2) = 75 δ̄.
#[test]
fn the_papers_rotation_has_an_unequal_inertia() {
    let noise = 0.05 * 3.0_f64.sqrt();
    let inertia = Matrix3::from_diagonal(&nalgebra::Vector3::new(0.2, 15.0, 15.0));
    let design = RotationDesign {
        channel: paper(inertia, 0.1, (DeadZoneShape::Quadratic, 0.1), noise),
        gyroscopic_torque: GyroscopicTorque::Learned,
        attitude_fix_gain_per_s: 0.0,
        attitude_fix_hold_s: 0.0,
    };
    let report = DesignReport::of_rotation(&design, &design.channel.function().unwrap()).unwrap();
    assert!(report.observable && report.hurwitz && report.unobservable.is_empty());
    assert!((report.certificate.unwrap().e0() - 75.0 * noise).abs() < 1e-9);
    assert_eq!(verdict(&report, "d > d_N"), Verdict::Fails);
    assert!((report.level_set_factor() - 75.0_f64.sqrt()).abs() < 1e-9);
}

#[test]
fn a_position_fix_makes_the_position_observable() {
    let mut design = translation();
    design.position_fix_gain_per_s = 0.5;
    let report = report_of(&design);
    assert!(report.observable && report.hurwitz);
    assert!(report.poles.iter().filter(|pole| (pole.re + 0.5).abs() < 1e-9).count() == 3);
}

/// d_N = 2 (0.4437 · 3 + 40 δ̄ + 5)/80 with r_f = 3 and ξ̄ = 5.
#[test]
fn every_bound_adds_its_part() {
    let mut design = translation();
    design.channel.bounds.unmatched = 5.0;
    design.channel.bounds.residual_norm = 3.0;
    let report = report_of(&design);
    let noise = design.channel.bounds.noise;
    assert!((report.certificate.unwrap().e0() - 2.0 * (40.0 * noise + 5.0) / 80.0).abs() < 1e-12);
    let expected = 2.0 * (0.443_724_775_3 * 3.0 + 40.0 * noise + 5.0) / 80.0;
    assert!((report.certificate.unwrap().d_n() - expected).abs() < 1e-8);
}

#[test]
fn an_unstable_rate_is_a_finding() {
    let mut design = translation();
    design.channel.adaptation_rate *= 1e7;
    let report = report_of(&design);
    assert!(!report.sampled_data_stable());
    assert_eq!(verdict(&report, "sampled law"), Verdict::Fails);
}
