//! The scientific core: how an opening or an edge scatters signed rays. No ray tracing in here.

pub mod aperture;
pub mod chain;
pub mod crossing;
mod descent;
pub mod edge;
mod factors;
pub mod flanked;
mod hankel;
pub mod hatch;
pub mod mask;
mod multipole;
mod overlap;
mod product;
pub mod quadrature;
pub mod rectangle;
pub mod referee;
pub mod rim;
pub mod scatter;
pub mod series;
pub mod slit;
pub mod tables;
pub mod thick;
mod two_edges;
pub mod utd;
pub mod utd_opening;
pub mod wedge;
pub mod weight;
