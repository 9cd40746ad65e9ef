//! The command, as its users run it.

mod bad_input;
mod clocks;
mod closed_loop;
mod commands;
mod demo;
mod derivatives;
mod docs;
mod filter;
mod folds;
mod fusion;
mod generate;
mod guards;
mod joints;
mod narx;
mod narx_search;
mod objective;
mod outside;
mod parameters;
mod prepare;
mod real_data;
mod regulators;
mod replayed;
mod report;
mod resimulate;
mod robot_logs;
mod runner;
mod settings;
mod sindy;
mod sparse;
mod stats_files;
mod to_the_end;
mod trained;
mod ulog;
#[path = "../crates/log/tests/all/ulog_writer.rs"]
mod ulog_writer;
mod weak;
