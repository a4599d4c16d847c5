//! Formats numbers, poles, matrices and subspaces for reports.

use nalgebra::{Complex, DMatrix};

pub(crate) fn state_names(names: Option<&[String]>, n: usize) -> Vec<String> {
    names.map_or_else(|| (1..=n).map(|i| format!("x{i}")).collect(), <[String]>::to_vec)
}

pub(crate) fn axes(quantity: &str) -> impl Iterator<Item = String> {
    ["x", "y", "z"].map(|axis| format!("{quantity} {axis}")).into_iter()
}

/// A subspace by the states that span it, or by the combinations that they enter.
pub(crate) fn in_words(basis: &DMatrix<f64>, states: &[String]) -> Vec<String> {
    let share = |i: usize| basis.row(i).norm();
    let whole: Vec<_> = (0..states.len()).filter(|&i| share(i) > 1.0 - 1e-9).collect();
    let mixed: Vec<_> = (0..states.len()).filter(|&i| (1e-9..=1.0 - 1e-9).contains(&share(i))).collect();
    let mut words: Vec<String> = whole.iter().map(|&i| states[i].clone()).collect();
    // Three axes of one quantity are the quantity.
    for quantity in ["position", "velocity"] {
        if axes(quantity).all(|axis| words.contains(&axis)) {
            words.retain(|word| !axes(quantity).any(|axis| axis == *word));
            words.push(quantity.into());
        }
    }
    if !mixed.is_empty() {
        let names: Vec<_> = mixed.iter().map(|&i| states[i].as_str()).collect();
        words.push(format!("{} combinations of {}", basis.ncols() - whole.len(), names.join(" and ")));
    }
    words
}

pub(crate) fn pole_in_words(pole: &Complex<f64>) -> String {
    match pole.im == 0.0 {
        true => number(pole.re),
        false => {
            let sign = if pole.im < 0.0 { '-' } else { '+' };
            format!("{}{sign}{}i", number(pole.re), number(pole.im.abs()))
        }
    }
}

/// Six significant digits at most, without trailing zeros.
pub(crate) fn number(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        size if (1e-4..1e7).contains(&size) => {
            let unit = 10.0_f64.powi(size.log10().floor() as i32 - 5);
            // Through text, so that 0.1 + 0.2 is 0.3.
            let rounded: f64 = format!("{:.5e}", (x / unit).round() * unit).parse().unwrap_or(x);
            rounded.to_string()
        }
        _ => format!("{x:.4e}"),
    }
}

/// `P = 4 I`, `P = diag(…)`, or its rows.
pub(crate) fn matrix_in_words(name: &str, matrix: &DMatrix<f64>) -> String {
    let tolerance = 1e-9 * matrix.amax();
    let diagonal = matrix.diagonal();
    let is_diagonal = (matrix - DMatrix::from_diagonal(&diagonal)).amax() <= tolerance;
    if is_diagonal && diagonal.iter().all(|x| (x - diagonal[0]).abs() <= tolerance) {
        return format!("{name} = {} I", number(diagonal[0]));
    }
    let list = |entries: Vec<f64>| entries.into_iter().map(number).collect::<Vec<_>>().join(", ");
    if is_diagonal {
        return format!("{name} = diag({})", list(diagonal.iter().copied().collect()));
    }
    let rows: Vec<_> = matrix.row_iter().map(|row| list(row.iter().copied().collect())).collect();
    format!("{name} = [{}]", rows.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_at_any_size() {
        for (x, text) in [
            (0.0, "0"),
            (-10.0, "-10"),
            (0.019_595_917_9, "0.0195959"),
            (115_335.024_1, "115335"),
            (1e-7, "1.0000e-7"),
            (-1e300, "-1.0000e300"),
            (0.1 + 0.2, "0.3"),
        ] {
            assert_eq!(number(x), text);
        }
    }

    #[test]
    fn a_subspace_is_named_by_its_states_or_their_combinations() {
        let states: Vec<String> = axes("position").chain(axes("velocity")).collect();
        let mut basis = DMatrix::zeros(6, 2);
        basis[(0, 0)] = 1.0;
        (basis[(1, 1)], basis[(4, 1)]) = (0.6, 0.8);
        let words = in_words(&basis, &states);
        assert_eq!(words, ["position x", "1 combinations of position y and velocity y"]);
    }
}
