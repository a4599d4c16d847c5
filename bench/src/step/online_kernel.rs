//! An online kernel method of others: kernel recursive least squares (Engel, Mannor and Meir, 2004) from the crate
//! `irithyll`, with our kernel and our centers as its dictionary.
//!
//! It learns the same kind of function from the same outputs, one output each, so three of them make one step: each takes
//! the sample and tells the function's value there. It knows no plant and no dead zone, and is given the force that it
//! would have to find: only its cost is compared.

use super::channel::{KERNEL, LENGTH_SCALE};
use anyhow::bail;
use irithyll::learner::StreamingLearner;
use irithyll::learners::krls::{KRLS, Kernel};
use nalgebra::Vector3;
use observer::{Centers, RadialFunction};

struct Matern(RadialFunction);

impl Kernel for Matern {
    fn eval(&self, a: &[f64], b: &[f64]) -> f64 {
        let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
        self.0.value(squares.sqrt() / LENGTH_SCALE)
    }
}

/// Three KRLS, one for each axis of the force.
pub(super) struct OnlineKernelMethod {
    axes: [KRLS; 3],
}

/// A center enters the dictionary where P_N² with those before it is more: all do that a Gram matrix bears.
const INDEPENDENT: f64 = 1e-12;

impl OnlineKernelMethod {
    /// Takes the centers as its first samples.
    ///
    /// # Errors
    /// A center that does not enter the dictionary.
    ///
    /// # Cost
    /// About 3N³ multiply-adds.
    pub(super) fn new(centers: &Centers) -> anyhow::Result<Self> {
        let n = centers.n_centers();
        let radial = KERNEL.radial(3)?;
        let mut axes = std::array::from_fn(|_| KRLS::new(Box::new(Matern(radial.clone())), n, INDEPENDENT));
        for xi in centers.points() {
            let force = force(&Vector3::from_column_slice(xi));
            axes.iter_mut().zip(&force).for_each(|(krls, &force)| krls.train(xi, force));
        }
        if let Some(krls) = axes.iter().find(|krls| krls.dict_size() != n) {
            bail!("only {} of {n} centers entered its dictionary", krls.dict_size());
        }
        Ok(Self { axes })
    }

    /// Takes one sample, and returns the function's value there.
    pub(super) fn step(&mut self, output: &Vector3<f64>) -> Vector3<f64> {
        let (y, force) = (output.as_slice(), force(output));
        Vector3::from_fn(|axis, _| {
            self.axes[axis].train(y, force[axis]);
            self.axes[axis].predict(y)
        })
    }
}

/// f(v) of the paper's translation (N).
fn force(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new((v.x * v.x).cos(), (v.y * v.y).sin() + v.x.sin(), v.z.cos() + v.y.sin())
}

#[cfg(test)]
mod tests {
    use super::super::channel::{centers, wandering_outputs};
    use super::*;

    /// It does what it is there for: on 64 centers it finds the force to a few percent.
    #[test]
    fn it_learns_the_force() {
        let mut method = OnlineKernelMethod::new(&centers(64).unwrap().0).unwrap();
        let outputs = wandering_outputs();
        let errors: Vec<f64> =
            outputs.iter().step_by(7).map(|y| (method.step(y) - force(y)).norm()).collect();
        let worst = errors[errors.len() / 2..].iter().copied().fold(0.0, f64::max);
        assert!(worst < 0.1, "{worst}");
    }
}
