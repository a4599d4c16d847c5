//! Lines for people and scripts. A reader that has gone (`| head`, a closed terminal) is no error: the
//! programs go on, where `println!` and `eprintln!` would end them.

/// A line of results, to stdout.
#[macro_export]
macro_rules! outln {
    ($($argument:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($argument)*);
    }};
}

/// A line of the log, to stderr.
#[macro_export]
macro_rules! logln {
    ($($argument:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($argument)*);
    }};
}
