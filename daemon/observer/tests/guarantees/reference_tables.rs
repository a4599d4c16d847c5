//! Kernels and native spaces, compared with values of mpmath and SciPy. Each table names the command that made it.

use observer::{Centers, Kernel, LengthScale, NativeSpace};

fn rows(table: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    table.lines().filter(|line| !line.starts_with('#')).skip(1).map(|line| line.split(',').collect())
}

/// Relative error below 1e-14 on all of it, and nothing at all at 0.
#[test]
fn every_kernel_has_fourteen_digits() {
    let (mut worst, mut n_rows) = (0.0_f64, 0);
    for row in rows(include_str!("../kernel_reference.csv")) {
        let [name, d, k, r, value] = row[..] else { panic!("{row:?}") };
        let dimension = d.parse().unwrap_or(3);
        let kernel = match name {
            "sobolev-matern" => Kernel::SobolevMatern { dimension, order: k.parse().unwrap() },
            "gaussian" => Kernel::Gaussian,
            "wendland-c2" => Kernel::WendlandC2,
            "wendland-c4" => Kernel::WendlandC4,
            name => panic!("{name}"),
        };
        let radial = kernel.radial(dimension).unwrap();
        let (r, expected): (f64, f64) = (r.parse().unwrap(), value.parse().unwrap());
        let found = radial.value(r);
        assert!(found >= 0.0 && found <= radial.value_at_zero() * (1.0 + f64::EPSILON), "{row:?}");
        assert!(r > 0.0 || found == radial.value_at_zero(), "{row:?}");
        // Near 1, Wendland's (1 − r)₊ has lost digits that r itself does not carry.
        let tolerance = if name.starts_with("wendland") { 4e-16 } else { 0.0 } + 1e-14 * expected;
        assert!((found - expected).abs() <= tolerance, "{row:?}: found {found:e}");
        if expected > 0.0 && !name.starts_with("wendland") {
            worst = worst.max((found / expected - 1.0).abs());
        }
        n_rows += 1;
    }
    println!("{n_rows} values, largest relative error {worst:.2e}");
    assert!(n_rows > 800);
}

fn space(case: &str) -> NativeSpace {
    let matern = |dimension| Kernel::SobolevMatern { dimension, order: 3 };
    let one = LengthScale::Isotropic(1.0);
    let (kernel, scale, centers) = match case {
        "A" => (matern(3), one, Centers::lattice([-1.0; 3], [1.0; 3], [3; 3])),
        "B" => (matern(3), one, Centers::lattice([-0.1; 3], [0.1; 3], [3; 3])),
        "C" => {
            let scale = LengthScale::PerAxis(vec![1.5, 0.5]);
            (matern(2), scale, Centers::lattice([-2.0, -1.0], [2.0, 1.0], [5, 4]))
        }
        "D" => (Kernel::Gaussian, one, Centers::lattice([-3.0], [3.0], [7])),
        "E" => {
            let scale = LengthScale::Isotropic(2.5);
            (Kernel::WendlandC2, scale, Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]))
        }
        case => panic!("{case}"),
    };
    NativeSpace::new(kernel, &scale, centers.unwrap(), 0.0).unwrap()
}

#[test]
fn native_spaces_have_the_values_of_the_table() {
    let mut n_rows = 0;
    for row in rows(include_str!("../native_space_reference.csv")) {
        let [quantity, case, value] = row[..] else { panic!("{row:?}") };
        let (space, expected): (_, f64) = (space(case), value.parse().unwrap());
        let point =
            |text: &str| -> Vec<f64> { text.split_whitespace().map(|c| c.parse().unwrap()).collect() };
        // P² is a difference of numbers near κ(0); in case B it is 1e-4 of them.
        let close = |found: f64, relative: f64| {
            assert!((found / expected - 1.0).abs() < relative, "{row:?}: found {found}");
        };
        match quantity.split_once(" at ") {
            None if quantity == "condition_number" => close(space.gram_condition(), 1e-4),
            None if quantity == "fill_distance" => {
                let found = space.fill_distance();
                close(found.value, 1e-6);
                assert!(found.upper_bound >= expected * (1.0 - 1e-12), "{row:?}: {found:?}");
            }
            None if quantity == "separation_distance" => close(space.separation().unwrap(), 1e-12),
            Some(("power_function", at)) => close(space.power_function_at(&point(at)), 1e-9),
            Some(("power_function_supremum", at)) => {
                close(space.power_function_at(&point(at)), 1e-9);
                let found = space.sup_power_function();
                close(found.value, 1e-7);
                assert!(found.upper_bound >= expected, "{row:?}: {found:?}");
                assert!(found.upper_bound < 1.5 * expected, "{row:?}: {found:?}");
                println!(
                    "{case}: {:.6} ≤ {:.6}, {} points",
                    found.value, found.upper_bound, found.evaluations
                );
            }
            _ => panic!("{row:?}"),
        }
        n_rows += 1;
    }
    assert_eq!(n_rows, 40);
}
