//! Pages as their readers get them.

mod page;
mod strict;
