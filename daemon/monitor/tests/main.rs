//! The integration tests of the monitor, in one program, which is linked once: made-up models, real services, and public
//! readers of its files.
//!
//! One program for all of them: it is linked once. Cargo builds `monitor` for it, but neither the service nor the
//! simulator: this program plays them (`testkit::Program::Played`).

mod across_domains;
mod lines;
mod mcap;
mod programs;
mod remote;
mod terminal;
mod view;

#[test]
fn role() {
    testkit::play_role(&[
        ("daemon", |arguments| daemon::cli::main_with_args(arguments)),
        ("sim_publisher", |arguments| sim_publisher::main_with_args(arguments)),
    ]);
}
