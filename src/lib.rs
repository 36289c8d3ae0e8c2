//! Acoustic ray tracing with diffraction by signed rays (see README.md).

pub mod error;
pub mod probe;
pub mod report;
pub mod response;
pub mod scene;
