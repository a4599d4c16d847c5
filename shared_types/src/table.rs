//! The table of a payload: one row for each field. Everything else that lists fields is made from it.
//!
//! | made from a table | by |
//! |---|---|
//! | the `#[repr(C)]` struct with its documentation, the bits of `valid` | the macros below |
//! | finiteness of a sample or estimate | [`numbers_are_finite`] |
//! | what the gate checks, faults, columns of imported tables, `inspect` | [`Field::quantity`], [`Field::limit`] |
//! | messages and schema of recordings | `monitor::messages` |
//! | the C header, `payload.py` | tests named `generated` of `observer_client` |
//!
//! A row: documentation, name, type, then `where BIT = place` if a bit of `valid` says whether the field carries
//! something, then in braces those columns of [`Field`] that differ from their defaults. [`crate::payload`] has the
//! tables. Depends on no other file.

/// The numbers that a payload is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // Rust's names
pub enum Scalar {
    U8,
    U32,
    U64,
    F64,
}

/// What a field holds.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// A single number.
    One(Scalar),
    /// That many numbers.
    Many(Scalar, usize),
    /// Another payload.
    Message(&'static Table),
}

/// The value of one field.
#[derive(Clone, Copy)]
pub enum Value<'a> {
    /// A whole number.
    Integer(u64),
    /// A number.
    Number(f64),
    /// Whole numbers.
    Integers(&'a [u64]),
    /// Numbers.
    Numbers(&'a [f64]),
    /// Bytes of a text.
    Bytes(&'a [u8]),
    /// Another payload.
    Message(&'a dyn Message),
}

/// What a sensor's field is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quantity {
    /// In words joined by `_`: the beginning of the column names of imported tables, the name in faults.
    pub key: &'static str,
    /// SI unit; empty for a unit quaternion and where the configuration decides.
    pub unit: &'static str,
    /// Whether a sensor reads it; otherwise it is commanded.
    pub is_measured: bool,
}

/// Which bound of the configuration limits a value: a key of `[input]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bound {
    /// `max_speed_m_s`.
    Speed,
    /// `max_angular_rate_rad_s`.
    AngularRate,
    /// `max_specific_force_m_s2`.
    SpecificForce,
    /// `max_position_m`.
    Position,
    /// `max_force_n`.
    Force,
    /// `max_torque_n_m`.
    Torque,
    /// `max_output`.
    Output,
    /// `max_input`.
    Input,
}

/// The requirement on the numbers of a field, beside that they are finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// Nothing.
    None,
    /// Their Euclidean norm is at most the bound.
    Norm(Bound),
    /// The magnitude of each is at most the bound.
    Each(Bound),
    /// Their Euclidean norm is one.
    UnitNorm,
    /// None is below zero.
    NotNegative,
}

/// Names of the numbers of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Components {
    /// Of all of them together.
    pub name: &'static str,
    /// Of each; empty for a list without names.
    pub names: &'static [&'static str],
}

/// A list without names.
pub const LIST: Components = Components { name: "", names: &[] };
/// Along three axes.
pub const XYZ: Components = Components { name: "Vector", names: &["x", "y", "z"] };
/// A unit quaternion.
pub const WXYZ: Components = Components { name: "Quaternion", names: &["w", "x", "y", "z"] };
/// 3-2-1 Euler angles.
pub const EULER: Components = Components { name: "Euler", names: &["roll", "pitch", "yaw"] };
/// Counts of the three channels.
pub const PER_CHANNEL: Components =
    Components { name: "PerChannel", names: &["translation", "rotation", "linear"] };
/// Sizes of the three channels, each in the unit that its field names.
pub const SIZE_PER_CHANNEL: Components = Components { name: "SizePerChannel", ..PER_CHANNEL };
/// Ages of the three channels, of which each may be unknown.
pub const AGE_PER_CHANNEL: Components = Components { name: "AgePerChannel", ..PER_CHANNEL };

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// With its unit.
    pub name: &'static str,
    /// What it is.
    pub doc: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// From the beginning of the payload (bytes).
    pub offset: usize,
    /// The bits of `valid` that say whether it carries something; 0: it always does.
    pub valid: u32,
    /// Names of its numbers.
    pub components: Components,
    /// What a sensor's field is about.
    pub quantity: Option<Quantity>,
    /// The requirement on its numbers.
    pub limit: Limit,
    /// The words of its bits.
    pub words: Option<&'static Constants>,
    /// The whole number that means unknown.
    pub unknown: Option<u64>,
    /// Whether +∞ is one of its values: it means unknown.
    pub may_be_infinite: bool,
}

impl Field {
    /// A row with nothing but its name, documentation and type.
    pub const fn new(name: &'static str, doc: &'static str, kind: Kind, offset: usize, valid: u32) -> Self {
        Self {
            name,
            doc,
            kind,
            offset,
            valid,
            components: LIST,
            quantity: None,
            limit: Limit::None,
            words: None,
            unknown: None,
            may_be_infinite: false,
        }
    }

    /// Names of the columns of an imported table that hold its numbers: `velocity_x`, ….
    pub fn columns(&self) -> Vec<String> {
        let key = self.quantity.map_or(self.name, |quantity| quantity.key);
        self.components.names.iter().map(|component| format!("{key}_{component}")).collect()
    }

    /// Bytes of memory.
    pub const fn bytes(&self) -> usize {
        let (scalar, n) = match self.kind {
            Kind::One(scalar) => (scalar, 1),
            Kind::Many(scalar, n) => (scalar, n),
            Kind::Message(table) => return table.bytes,
        };
        match scalar {
            Scalar::U8 => n,
            Scalar::U32 => 4 * n,
            Scalar::U64 | Scalar::F64 => 8 * n,
        }
    }
}

/// A payload's fields, in the order of memory.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    /// Rust's name of the payload.
    pub name: &'static str,
    /// Its name in shared memory, with the version of its layout.
    pub type_name: &'static str,
    /// What it is.
    pub doc: &'static str,
    /// Size of the whole.
    pub bytes: usize,
    /// Its alignment (bytes).
    pub align: usize,
    /// The rows.
    pub fields: &'static [Field],
}

impl Table {
    /// Whether the fields follow each other without gaps to the end, and as many numbers have names as there are.
    pub const fn is_sound(&self) -> bool {
        let mut end = 0;
        let mut i = 0;
        while i < self.fields.len() {
            let field = &self.fields[i];
            let n_names = field.components.names.len();
            let are_named = matches!(field.kind, Kind::Many(_, n) if n == n_names) || n_names == 0;
            if field.offset != end || !are_named {
                return false;
            }
            end += field.bytes();
            i += 1;
        }
        self.bytes == end
    }
}

/// A payload whose fields can be read by their place in its table.
pub trait Message {
    /// Its fields.
    fn table(&self) -> &'static Table;
    /// The value of a field.
    fn value(&self, field: usize) -> Value<'_>;
    /// The numbers of a field, to change them; none where it holds something else.
    fn numbers_mut(&mut self, field: usize) -> &mut [f64];
}

/// A payload whose table is known without one of its messages.
pub trait Payload: Message + Sized {
    /// Its fields.
    const TABLE: Table;
}

/// Whether every number is finite, or +∞ where that means unknown, in fields of several numbers that are valid.
pub fn numbers_are_finite(message: &impl Message, valid: u32) -> bool {
    let fields = message.table().fields.iter().enumerate();
    let mut valid = fields.filter(|(_, field)| valid & field.valid == field.valid);
    valid.all(|(i, field)| match message.value(i) {
        Value::Numbers(numbers) => numbers
            .iter()
            .all(|number| number.is_finite() || (field.may_be_infinite && *number == f64::INFINITY)),
        _ => true,
    })
}

/// One constant: its value, and the word of a bit, if it has one.
#[derive(Debug, Clone, Copy)]
pub struct Constant {
    /// Its name in Rust.
    pub name: &'static str,
    /// What it means.
    pub doc: &'static str,
    /// Its value.
    pub value: u64,
    /// Its word in messages; may be empty.
    pub word: &'static str,
}

/// A module of constants.
#[derive(Debug, Clone, Copy)]
pub struct Constants {
    /// The module's name.
    pub name: &'static str,
    /// What they are.
    pub doc: &'static str,
    /// Whether they are of 64 bits; otherwise of 32.
    pub is_wide: bool,
    /// Each of them.
    pub constants: &'static [Constant],
}

impl Constants {
    /// The bits that are set, in words.
    pub fn words(&self, bits: u64) -> Vec<&'static str> {
        let named = self.constants.iter().filter(|constant| !constant.word.is_empty());
        named.filter(|constant| bits & constant.value != 0).map(|constant| constant.word).collect()
    }
}

/// What a field of a payload may hold.
pub trait Holds {
    /// As the table says it.
    const KIND: Kind;
    /// As a value.
    fn value(&self) -> Value<'_>;
    /// To change it.
    fn numbers_mut(&mut self) -> &mut [f64] {
        &mut []
    }
}

macro_rules! holds {
    ($($type:ty $([$n:ident])? = $kind:expr, $value:expr;)+) => {$(
        impl$(<const $n: usize>)? Holds for $type {
            const KIND: Kind = $kind;
            fn value(&self) -> Value<'_> {
                $value(self)
            }
        }
    )+};
}

holds! {
    u32 = Kind::One(Scalar::U32), |number: &u32| Value::Integer((*number).into());
    u64 = Kind::One(Scalar::U64), |number: &u64| Value::Integer(*number);
    f64 = Kind::One(Scalar::F64), |number: &f64| Value::Number(*number);
    [u8; N] [N] = Kind::Many(Scalar::U8, N), Value::Bytes;
    [u64; N] [N] = Kind::Many(Scalar::U64, N), Value::Integers;
}

impl<const N: usize> Holds for [f64; N] {
    const KIND: Kind = Kind::Many(Scalar::F64, N);

    fn value(&self) -> Value<'_> {
        Value::Numbers(self)
    }

    fn numbers_mut(&mut self) -> &mut [f64] {
        self
    }
}

impl<T: Payload> Holds for T {
    const KIND: Kind = Kind::Message(&T::TABLE);

    fn value(&self) -> Value<'_> {
        Value::Message(self)
    }
}

/// Makes a payload of its table.
macro_rules! payload {
    (
        $(#[doc = $doc:literal])+
        $(#[derive($($derive:ident),+)])?
        pub struct $name:ident: $type_name:literal {
            $(
                $(#[doc = $field_doc:literal])+
                $(#[serde($serde:ident)])?
                $field:ident: $type:ty
                $(where $bit:ident = $place:literal)?
                $({ $($column:ident: $value:expr),+ $(,)? })?,
            )+
        }
    ) => {
        $(#[doc = $doc])+
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, $($($derive),+)?)]
        #[type_name($type_name)]
        pub struct $name {
            $(
                $(#[doc = $field_doc])+
                $(#[serde($serde)])?
                pub $field: $type,
            )+
        }

        impl $crate::table::Payload for $name {
            const TABLE: $crate::table::Table = $crate::table::Table {
                name: stringify!($name),
                type_name: $type_name,
                doc: concat!($($doc),+),
                bytes: size_of::<$name>(),
                align: align_of::<$name>(),
                #[allow(clippy::needless_update)] // a row may give all columns
                fields: &[$($crate::table::Field {
                    $($($column: $value,)+)?
                    ..$crate::table::Field::new(
                        stringify!($field),
                        concat!($($field_doc),+),
                        <$type as $crate::table::Holds>::KIND,
                        std::mem::offset_of!($name, $field),
                        0 $(| valid::$bit)?,
                    )
                }),+],
            };
        }

        impl $crate::table::Message for $name {
            fn table(&self) -> &'static $crate::table::Table {
                &<Self as $crate::table::Payload>::TABLE
            }

            fn value(&self, field: usize) -> $crate::table::Value<'_> {
                let values: [fn(&Self) -> $crate::table::Value<'_>; _] =
                    [$(|message| $crate::table::Holds::value(&message.$field)),+];
                values[field](self)
            }

            fn numbers_mut(&mut self, field: usize) -> &mut [f64] {
                let values: [fn(&mut Self) -> &mut [f64]; _] =
                    [$(|message| $crate::table::Holds::numbers_mut(&mut message.$field)),+];
                values[field](self)
            }
        }
    };
    (
        $(#[doc = $mask_doc:literal])+
        pub mod valid: u32 {
            $($(#[doc = $group_doc:literal])+ $group:ident = $mask:expr,)+
        }
        $(#[doc = $doc:literal])+
        $(#[derive($($derive:ident),+)])?
        pub struct $name:ident: $type_name:literal {
            $(
                $(#[doc = $field_doc:literal])+
                $field:ident: $type:ty
                $(where $bit:ident = $place:literal)?
                $({ $($column:ident: $value:expr),+ $(,)? })?,
            )+
        }
    ) => {
        constants! {
            $(#[doc = $mask_doc])+
            pub mod valid: u32 {
                $($(#[doc = concat!(" `", stringify!($field), "`.")] $bit = 1 << $place;)?)+
                $($(#[doc = $group_doc])+ $group = $mask;)+
                /// Every bit that has a meaning.
                ALL = 0 $($(| $bit)?)+;
            }
        }

        payload! {
            $(#[doc = $doc])+
            $(#[derive($($derive),+)])?
            pub struct $name: $type_name {
                $(
                    $(#[doc = $field_doc])+
                    $field: $type $(where $bit = $place)? $({ $($column: $value),+ })?,
                )+
            }
        }
    };
}

/// Makes a module of constants, each with its documentation and, for people, the word of a bit.
#[macro_export]
macro_rules! constants {
    (
        $(#[doc = $doc:literal])+
        pub mod $module:ident: $type:ident $(with $words:ident)? {
            $($(#[doc = $constant_doc:expr])+ $name:ident = $value:expr $(, $word:literal)?;)+
        }
    ) => {
        $(#[doc = $doc])+
        pub mod $module {
            use $crate::table::{Constant, Constants};

            $($(#[doc = $constant_doc])+ pub const $name: $type = $value;)+

            /// All of them, with their documentation.
            pub const TABLE: Constants = Constants {
                name: stringify!($module),
                doc: concat!($($doc),+),
                is_wide: size_of::<$type>() == 8,
                constants: &[$(Constant {
                    name: stringify!($name),
                    doc: concat!($($constant_doc),+),
                    value: $name as u64,
                    word: concat!($($word)?),
                }),+],
            };

            $(
                /// The set bits in words, for people.
                pub fn $words(bits: $type) -> Vec<&'static str> {
                    TABLE.words(bits)
                }
            )?
        }
    };
}
