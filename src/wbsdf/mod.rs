//! The scientific core: how an opening or an edge scatters signed rays. No ray tracing in here.

pub mod aperture;
pub mod crossing;
pub mod edge;
mod hankel;
pub mod hatch;
pub mod mask;
mod overlap;
mod product;
pub mod quadrature;
pub mod rectangle;
pub mod rim;
pub mod scatter;
pub mod slit;
pub mod thick;
pub mod wedge;
pub mod weight;
