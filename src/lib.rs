#![doc = include_str!("../README.md")]

pub mod error;
pub mod geometry;
pub mod paths;
pub mod plan;
pub mod probe;
pub mod report;
pub mod response;
pub mod scene;
pub mod simulate;
pub mod sweep;
pub mod trace;
pub mod verify;
pub mod wbsdf;
