//! Write permissions and their criticality: the paper's Table 1 in a form that the compiler checks.
//!
//! # The table
//!
//! In the paper's Table 1 a row is a source, and a column is a destination:
//!
//! | from \ to | Base Station | HORUS | Flight Controller | Active Load |
//! |---|---|---|---|---|
//! | Base Station | | | Safety relevant | Non-critical |
//! | HORUS | Safety relevant | | Safety relevant | |
//! | Flight Controller | Safety relevant | | | Non-critical |
//! | Active Load | Non-critical | | Non-critical | |
//!
//! The DPR is the medium and not in the table. It writes [Link-Status](crate::LinkStatus) and
//! [Port-Status](crate::PortStatus) for the flight controller and the base station, and accepts
//! [commands](crate::Command) from the flight controller.
//!
//! # Use
//!
//! Each cell that is not empty is one implementation of [`Sends`]. Each object of the memory map is a type in
//! [`object`] that names the only role that [may write](MayWrite) the object. A role [may read](MayRead) an object if
//! the table lets the object's writer send to the role.
//!
//! A function that writes an object takes a [`Writer`] of the role that may write it. A program claims its roles at its
//! start:
//!
//! ```
//! use profile::criticality::{BaseStation, Writer};
//! use profile::{Identifier, Uplink, UplinkValues};
//!
//! let writer = Writer::<BaseStation>::claim();
//! let uplink = Uplink::seal(writer, &UplinkValues { timestamp: 1, ..UplinkValues::default() });
//! assert_eq!(uplink.identifier(), Identifier::UPLINK_BASE_STATION);
//! ```
//!
//! HORUS has no uplink:
//!
//! ```compile_fail,E0277
//! use profile::criticality::{Horus, Writer};
//! let uplink = profile::Uplink::seal(Writer::<Horus>::claim(), &profile::UplinkValues::default());
//! ```
//!
//! The flight controller's objects never reach HORUS. Code cannot declare that HORUS reads them:
//!
//! ```compile_fail,E0277
//! use profile::criticality::{Criticality, FlightController, Horus, MayRead, object::UplinkFrom};
//! const LEVEL: Criticality = <Horus as MayRead<UplinkFrom<FlightController>>>::CRITICALITY;
//! ```
//!
//! ```compile_fail,E0117
//! use profile::criticality::{BaseStation, Criticality, Horus, Sends};
//! impl Sends<Horus> for BaseStation {
//!     const CRITICALITY: Criticality = Criticality::NonCritical;
//! }
//! ```
//!
//! Only HORUS writes the profile, and only the DPR writes its own objects:
//!
//! ```compile_fail,E0271
//! use profile::criticality::{FlightController, Writer};
//! let mut map = [0; profile::map::Map::<3>::LEN];
//! profile::map::profile_object_mut::<_, 3>(Writer::<FlightController>::claim(), &mut map, 0);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{Horus, Writer};
//! let mut map = [0; profile::map::Map::<3>::LEN];
//! profile::map::link_status_mut(Writer::<Horus>::claim(), &mut map);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{FlightController, Writer};
//! profile::PortStatus::seal(Writer::<FlightController>::claim(), &profile::PortValues::default());
//! ```
//!
//! The base station has no commands:
//!
//! ```compile_fail,E0271
//! use profile::{Command, CommandObject, criticality::{BaseStation, Writer}};
//! CommandObject::seal(Writer::<BaseStation>::claim(), 0, Command::SelfTest);
//! ```
//!
//! The [hold](crate::hold) writes only its own object, and no other role writes that object:
//!
//! ```
//! use profile::criticality::{ActiveLoad, Criticality, FlightController, MayRead, Writer, object};
//! profile::HoldStatus::seal(Writer::<ActiveLoad>::claim(), &profile::HoldValues::absent(0));
//! const LEVEL: Criticality = <ActiveLoad as MayRead<object::UplinkFrom<FlightController>>>::CRITICALITY;
//! assert_eq!(LEVEL, Criticality::NonCritical);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{FlightController, Writer};
//! profile::HoldStatus::seal(Writer::<FlightController>::claim(), &profile::HoldValues::absent(0));
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{BaseStation, Writer};
//! profile::HoldStatus::seal(Writer::<BaseStation>::claim(), &profile::HoldValues::absent(0));
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{Horus, Writer};
//! profile::HoldStatus::seal(Writer::<Horus>::claim(), &profile::HoldValues::absent(0));
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{Dpr, Writer};
//! let mut map = [0; profile::map::Map::<3>::LEN_WITH_HOLD];
//! profile::map::hold_mut::<_, 3>(Writer::<Dpr>::claim(), &mut map);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{ActiveLoad, Writer};
//! let mut map = [0; profile::map::Map::<3>::LEN_WITH_HOLD];
//! profile::map::profile_object_mut::<_, 3>(Writer::<ActiveLoad>::claim(), &mut map, 0);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{ActiveLoad, Writer};
//! let mut map = [0; profile::map::Map::<3>::LEN_WITH_HOLD];
//! profile::map::link_status_mut(Writer::<ActiveLoad>::claim(), &mut map);
//! ```
//!
//! ```compile_fail,E0271
//! use profile::criticality::{ActiveLoad, Writer};
//! profile::PortStatus::seal(Writer::<ActiveLoad>::claim(), &profile::PortValues::default());
//! ```
//!
//! ```compile_fail,E0277
//! use profile::criticality::{ActiveLoad, Writer};
//! profile::Uplink::seal(Writer::<ActiveLoad>::claim(), &profile::UplinkValues::default());
//! ```
//!
//! ```compile_fail,E0271
//! use profile::{Command, CommandObject, criticality::{ActiveLoad, Writer}};
//! CommandObject::seal(Writer::<ActiveLoad>::claim(), 0, Command::SelfTest);
//! ```
//!
//! The hold does not read the objects of HORUS or of the DPR, and HORUS does not read the hold's object. Code cannot
//! declare otherwise:
//!
//! ```compile_fail,E0277
//! use profile::criticality::{ActiveLoad, Criticality, MayRead, object};
//! const LEVEL: Criticality = <ActiveLoad as MayRead<object::Profile>>::CRITICALITY;
//! ```
//!
//! ```compile_fail,E0277
//! use profile::criticality::{ActiveLoad, Criticality, MayRead, object};
//! const LEVEL: Criticality = <ActiveLoad as MayRead<object::PortStatus>>::CRITICALITY;
//! ```
//!
//! ```compile_fail,E0277
//! use profile::criticality::{Criticality, Horus, MayRead, object};
//! const LEVEL: Criticality = <Horus as MayRead<object::Hold>>::CRITICALITY;
//! ```
//!
//! ```compile_fail,E0117
//! use profile::criticality::{ActiveLoad, Criticality, Horus, Sends};
//! impl Sends<Horus> for ActiveLoad {
//!     const CRITICALITY: Criticality = Criticality::NonCritical;
//! }
//! ```
//!
//! These types prevent mistakes at no cost at run time. They do not stop intent: a program can claim any role. So the
//! receiver of an object judges it by CRC, identifier and timestamp.
use core::{fmt, marker::PhantomData};

/// The criticality of a communication (paper, Table 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Criticality {
    /// A safety function relies on the communication.
    SafetyRelevant,
    /// No safety function relies on the communication.
    NonCritical,
}

impl fmt::Display for Criticality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::SafetyRelevant => "Safety relevant",
            Self::NonCritical => "Non-critical",
        })
    }
}

/// A function of the system that writes objects, as a value; a [`Role`] is the same as a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Function {
    /// The base station.
    BaseStation,
    /// HORUS.
    Horus,
    /// The flight controller.
    FlightController,
    /// The active load (the paper's active-hold): the [hold](crate::hold).
    ActiveLoad,
    /// The DPR, which is the medium between the others.
    Dpr,
}

impl Function {
    /// The rows and columns of the paper's Table 1, in its order.
    pub const TABLE_1: [Self; 4] = [Self::BaseStation, Self::Horus, Self::FlightController, Self::ActiveLoad];
}

impl fmt::Display for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::BaseStation => "Base Station",
            Self::Horus => "HORUS",
            Self::FlightController => "Flight Controller",
            Self::ActiveLoad => "Active Load",
            Self::Dpr => "DPR",
        })
    }
}

mod sealed {
    pub trait Sealed {}
}

/// A function of the system that writes objects, as a type. No other module can define a role.
pub trait Role: sealed::Sealed + Copy + fmt::Debug + 'static {
    /// The role as a value of [`Function`].
    const FUNCTION: Function;
}

macro_rules! roles {
    ($($(#[$doc:meta])* $role:ident,)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $role;
        impl sealed::Sealed for $role {}
        impl Role for $role {
            const FUNCTION: Function = Function::$role;
        }
    )*};
}

roles! {
    /// The base station.
    BaseStation,
    /// HORUS, which writes the profile and reads no object.
    Horus,
    /// The flight controller.
    FlightController,
    /// The active load.
    ActiveLoad,
    /// The DPR.
    Dpr,
}

/// The role may send to the role `To`, because the [table](self)'s cell for these two roles is not empty.
pub trait Sends<To: Role>: Role {
    /// The criticality of what the role sends to the role `To`.
    const CRITICALITY: Criticality;
}

/// Makes an implementation of [`Sends`] and a case of [`criticality`] from each cell of the table.
macro_rules! cells {
    ($($from:ident => $to:ident: $criticality:ident;)*) => {
        $(
            impl Sends<$to> for $from {
                const CRITICALITY: Criticality = Criticality::$criticality;
            }
        )*

        /// The criticality of what `from` sends to `to`; `None` if `from` may not send to `to`.
        ///
        /// ```
        /// use profile::criticality::{Criticality, Function, criticality};
        ///
        /// assert_eq!(criticality(Function::Horus, Function::FlightController), Some(Criticality::SafetyRelevant));
        /// assert_eq!(criticality(Function::FlightController, Function::Horus), None);
        /// ```
        #[must_use]
        pub const fn criticality(from: Function, to: Function) -> Option<Criticality> {
            match (from, to) {
                $((Function::$from, Function::$to) => Some(<$from as Sends<$to>>::CRITICALITY),)*
                _ => None,
            }
        }
    };
}

cells! {
    BaseStation => FlightController: SafetyRelevant;
    BaseStation => ActiveLoad: NonCritical;
    Horus => BaseStation: SafetyRelevant;
    Horus => FlightController: SafetyRelevant;
    FlightController => BaseStation: SafetyRelevant;
    FlightController => ActiveLoad: NonCritical;
    ActiveLoad => BaseStation: NonCritical;
    ActiveLoad => FlightController: NonCritical;
    // The DPR's own objects are safety-relevant, because readers judge HORUS's objects by them.
    Dpr => BaseStation: SafetyRelevant;
    Dpr => FlightController: SafetyRelevant;
    FlightController => Dpr: NonCritical;
}

/// The objects of the memory map, each with the only role that writes it.
pub mod object {
    use core::marker::PhantomData;

    use super::{ActiveLoad, Dpr, FlightController, Horus, Role, WritesUplink};

    /// An object of the memory map, or a kind of object with one writer.
    pub trait MapObject {
        /// The only role that writes the object.
        type Writer: Role;
    }

    macro_rules! objects {
        ($($(#[$doc:meta])* $object:ident by $writer:ty;)*) => {$(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub struct $object;
            impl MapObject for $object {
                type Writer = $writer;
            }
        )*};
    }

    objects! {
        /// Reported-Position and GPS1 to GPSn.
        Profile by Horus;
        /// Link-Status.
        LinkStatus by Dpr;
        /// Port-Status.
        PortStatus by Dpr;
        /// The command object, which the DPR does not store.
        Command by FlightController;
        /// Hold-Status, or the object of another maker's [hold](crate::hold).
        Hold by ActiveLoad;
    }

    /// The uplink that the role `W` writes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct UplinkFrom<W>(PhantomData<W>);

    impl<W: WritesUplink> MapObject for UplinkFrom<W> {
        type Writer = W;
    }
}

use object::MapObject;

/// The role may write the object `O`.
pub trait MayWrite<O: MapObject>: Role {}
impl<W: Role, O: MapObject<Writer = W>> MayWrite<O> for W {}

/// The role may read the object `O`, because the [table](self) lets the object's writer send to the role.
pub trait MayRead<O: MapObject>: Role {
    /// The criticality of the object for the role that reads it.
    const CRITICALITY: Criticality;
}

impl<R: Role, O: MapObject<Writer: Sends<R>>> MayRead<O> for R {
    const CRITICALITY: Criticality = <O::Writer as Sends<R>>::CRITICALITY;
}

/// The role has an uplink: an object that the role writes over the SSI and that the map stores.
pub trait WritesUplink: Role {
    /// The uplink's identifier.
    const IDENTIFIER: crate::Identifier;
    /// The index of the role's uplink among the uplinks of the map, from 0.
    const INDEX: usize;
}

impl WritesUplink for BaseStation {
    const IDENTIFIER: crate::Identifier = crate::Identifier::UPLINK_BASE_STATION;
    const INDEX: usize = 0;
}

impl WritesUplink for FlightController {
    const IDENTIFIER: crate::Identifier = crate::Identifier::UPLINK_FLIGHT_CONTROLLER;
    const INDEX: usize = 1;
}

/// A proof, without bytes or cost, that the program may write the objects of role `W`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Writer<W>(PhantomData<W>);

impl<W: Role> Writer<W> {
    /// Claims that this program has role `W`, or that it passes on unchanged what `W` has sent.
    #[must_use]
    pub const fn claim() -> Self {
        Self(PhantomData)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::{format, string::String};

    use super::*;

    fn table() -> String {
        let mut table = String::from("| from \\ to |");
        for to in Function::TABLE_1 {
            table += &format!(" {to} |");
        }
        table += "\n|---|---|---|---|---|\n";
        for from in Function::TABLE_1 {
            table += &format!("| {from} |");
            for to in Function::TABLE_1 {
                table += &criticality(from, to).map_or_else(|| String::from(" |"), |level| format!(" {level} |"));
            }
            table += "\n";
        }
        table
    }

    // Shows WAY-1.
    #[test]
    fn the_cells_are_those_of_the_papers_table_1() {
        let paper = "\
            | from \\ to | Base Station | HORUS | Flight Controller | Active Load |\n\
            |---|---|---|---|---|\n\
            | Base Station | | | Safety relevant | Non-critical |\n\
            | HORUS | Safety relevant | | Safety relevant | |\n\
            | Flight Controller | Safety relevant | | | Non-critical |\n\
            | Active Load | Non-critical | | Non-critical | |\n";
        assert_eq!(table(), paper);
    }

    #[test]
    fn the_table_of_the_documentation_is_the_one_that_the_compiler_checks() {
        let documentation: String = include_str!("criticality.rs")
            .lines()
            .filter_map(|line| line.strip_prefix("//! |"))
            .fold(String::new(), |mut rows, row| {
                rows += &format!("|{row}\n");
                rows
            });
        assert_eq!(documentation, table());
    }

    // Shows WAY-1.
    #[test]
    fn nobody_sends_to_horus_and_horus_sends_to_no_one_below() {
        for from in [Function::TABLE_1.as_slice(), &[Function::Dpr]].concat() {
            assert_eq!(criticality(from, Function::Horus), None, "{from}");
        }
        assert_eq!(criticality(Function::Horus, Function::ActiveLoad), None);
        assert_eq!(criticality(Function::Horus, Function::Dpr), None);
        assert_eq!(criticality(Function::ActiveLoad, Function::Dpr), None);
    }

    #[test]
    fn each_object_has_the_criticality_of_its_writer_for_every_reader() {
        const SAFETY: Criticality = <FlightController as MayRead<object::Profile>>::CRITICALITY;
        const LOAD: Criticality = <ActiveLoad as MayRead<object::UplinkFrom<BaseStation>>>::CRITICALITY;
        assert_eq!((SAFETY, LOAD), (Criticality::SafetyRelevant, Criticality::NonCritical));
        assert_eq!(<BaseStation as MayRead<object::LinkStatus>>::CRITICALITY, Criticality::SafetyRelevant);
        assert_eq!(<Dpr as MayRead<object::Command>>::CRITICALITY, Criticality::NonCritical);
    }

    #[test]
    fn a_writer_has_no_bytes() {
        assert_eq!(size_of::<Writer<Horus>>(), 0);
    }
}
