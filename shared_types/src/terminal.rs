//! Printing lines to stdout and stderr. A reader that has ended (`| head`, a closed terminal) is not an error: the program
//! continues, where `println!` and `eprintln!` would panic.

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
