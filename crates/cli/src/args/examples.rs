//! Examples at the end of every command's help: lines to copy. A test parses them.

pub(crate) const OVERVIEW: &str = "\
From a log to a model:
  fleetfoot demo                                  from a log to equations and code, in a minute
  fleetfoot auto run.mcap -o model/               a model of your own log, with its held-out error
  fleetfoot info run.mcap                         columns, rows and rates of the log
  fleetfoot init run.mcap -o robot.toml           a commented recipe, to be edited
  fleetfoot fit pwa -c robot.toml runs/           a model, in model.json
  fleetfoot score model.json held-out.mcap        its errors on rows that did not train it
  fleetfoot show model.json                       its equations
  fleetfoot export model.json --to c -o src/      its code";

pub(crate) const DEMO: &str = "\
Examples:
  fleetfoot demo
  fleetfoot demo --paper --minutes 2 --seed 3 -o /tmp/demo";

pub(crate) const INFO: &str = "\
Examples:
  fleetfoot info run.mcap
  fleetfoot info runs/ --correlation
  fleetfoot info run.csv --lag v_ref,v --reach 200";

pub(crate) const AUTO: &str = "\
Examples:
  fleetfoot auto run.mcap
  fleetfoot auto runs/ --states x,v --inputs u -o model/ --export c";

pub(crate) const CHECK: &str = "\
Examples:
  fleetfoot check run.mcap
  fleetfoot check runs/ -c robot.toml --strict";

pub(crate) const INIT: &str = "\
Examples:
  fleetfoot init run.mcap
  fleetfoot init runs/ -o robot.toml              folders of imu.csv, odom.csv, ...: a recipe that joins them";

pub(crate) const SCHEMA: &str = "\
Examples:
  fleetfoot schema
  fleetfoot schema -o recipe.schema.json          begin recipes with: #:schema ./recipe.schema.json";

pub(crate) const PREPARE: &str = "\
Examples:
  fleetfoot prepare -c robot.toml runs/ -o clean/
  fleetfoot prepare -c robot.toml runs/ -o clean/ --method quintic --second-order --dejitter";

pub(crate) const SCAN: &str = "\
Examples:
  fleetfoot scan -c robot.toml runs/ --partition kmeans:2,5,10 -o run.stats
  fleetfoot scan -c robot.toml today/ -o run.stats --append
  fleetfoot scan -c robot.toml fleet/ -o fleet.stats --key 'aircraft={dir1}'";

pub(crate) const STATS_INFO: &str = "\
Examples:
  fleetfoot stats info run.stats --episodes";

pub(crate) const STATS_MERGE: &str = "\
Examples:
  fleetfoot stats merge monday.stats tuesday.stats -o week.stats";

pub(crate) const STATS_DROP: &str = "\
Examples:
  fleetfoot stats drop fleet.stats --where aircraft=3 -o without_3.stats";

pub(crate) const STATS_COMPACT: &str = "\
Examples:
  fleetfoot stats compact fleet.stats -o small.stats";

pub(crate) const FIT_NETWORK: &str = "\
Examples:
  fleetfoot fit network log.csv --states x,v --inputs u --predict next --lags 3";

pub(crate) const FIT_PWA: &str = "\
Examples:
  fleetfoot fit pwa -c robot.toml runs/ --partition null,average,kmeans:2,5,10
  fleetfoot fit pwa log.csv --states x,v --inputs u --partition labels:terrain
  fleetfoot fit pwa log.csv --states y --inputs u --predict next --lags 3 --partition kmeans:5 --partition-on 'y,lag(y,1),u'";

pub(crate) const FIT_SPARSE: &str = "\
Examples:
  fleetfoot fit sparse -c aircraft.toml climbs/ --bolasso episodes:200 --threshold 0.9
  fleetfoot fit sparse -c aircraft.toml fleet.stats --by aircraft --frequencies frequencies.parquet";

pub(crate) const FIT_SINDY: &str = "\
Examples:
  fleetfoot fit sindy log.csv --states x,y,z --library 'poly(3),sin' --threshold 0.5
  fleetfoot fit sindy run.stats --partition kmeans:5
  fleetfoot fit sindy -c motor.toml runs/ --front --keep-all";

pub(crate) const FIT_NARX: &str = "\
Examples:
  fleetfoot fit narx train.csv --outputs y --inputs u --free-run test.csv
  fleetfoot fit narx log.csv --outputs y --inputs u --lags-out 2 --lags-in 2 --degree 3 --test-share 0.2
  fleetfoot fit narx run.stats --select bic --free-run test.csv";

pub(crate) const FIT_PARAMETERS: &str = "\
Examples:
  fleetfoot fit parameters -c robot.toml runs/
  fleetfoot fit parameters -c robot.toml runs/ --segment 500 --compare q --parameter 'mass=90 in 50..150'";

pub(crate) const SCORE: &str = "\
Examples:
  fleetfoot score model.json held-out.mcap --episodes
  fleetfoot score model.json test/ --plane alpha_l,alpha_r";

pub(crate) const CONTROL_LQR: &str = "\
Examples:
  fleetfoot control lqr model.json --setpoint x=0,y=0 --limits u_v=0:1 --integral x=10 -o controller.json";

pub(crate) const CONTROL_MPC: &str = "\
Examples:
  fleetfoot control mpc model.json --setpoint y=0,v=0.3 --limits v_command=0:1 --bounds y=-0.1:0.1 -o controller.json
  fleetfoot control mpc model.json --setpoint x=0,y=0 --limits u_v=-1:1 --horizon 40";

pub(crate) const FILTER: &str = "\
Examples:
  fleetfoot filter model.json run.parquet --measured x=0.01,yaw=0.02 -o estimates.parquet
  fleetfoot filter model.json run.mcap --sensors v=/odom.twist.twist.linear.x --truth v=/truth/odometry.twist.twist.linear.x";

pub(crate) const PREDICT: &str = "\
Examples:
  fleetfoot predict model.json run.mcap -o predicted.mcap";

pub(crate) const ROLLOUT: &str = "\
Examples:
  fleetfoot rollout model.json held-out.mcap --horizon 50 --starts 500 -o rollouts.parquet
  fleetfoot rollout model.json test/ --controller treadmill --controller-set k_x=2,speed=0.25";

pub(crate) const FREQUENCY: &str = "\
Examples:
  fleetfoot frequency model.json held-out.mcap --input u --output v --page bode.html
  fleetfoot frequency -c stage.toml multisine/ --input tau --output v --period 4";

pub(crate) const RESIMULATE: &str = "\
Examples:
  fleetfoot resimulate model.json flight.parquet -o followed.parquet
  fleetfoot resimulate model.json flights/ --bounds N1=0.2..1 --deviations V=0.5,h=10 --episodes";

pub(crate) const REPORT: &str = "\
Examples:
  fleetfoot report model.json held-out.mcap -o report.html
  fleetfoot report model_average.json model_kmeans10.json test/ --horizon 100 --svg figures/";

pub(crate) const SHOW: &str = "\
Examples:
  fleetfoot show model.json --regions 3";

pub(crate) const EXPORT: &str = "\
Examples:
  fleetfoot export model.json --to c --precision float --prefix robot --discretize 0.002 -o src/
  fleetfoot export network.json --to onnx --precision float";

pub(crate) const IMPORT: &str = "\
Examples:
  fleetfoot import net.onnx training/ -c robot.toml -o model.json";

pub(crate) const GENERATE: &str = "\
Examples:
  fleetfoot generate hexapod --minutes 20 --speed 0.1:0.5 --runs 16 -o runs/
  fleetfoot generate quadrotor --set 'wind.mean=[5, 0, 0]' --dry-run -o flights/
  fleetfoot generate hexapod --print-world";

pub(crate) const COMPLETIONS: &str = "\
Examples:
  fleetfoot completions bash";

pub(crate) const MAN: &str = "\
Examples:
  fleetfoot man -o man/man1";

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use crate::args::Cli;

    /// A line's words, as a shell splits them: at blanks that no quotes hold.
    fn words(line: &str) -> Vec<String> {
        let mut words = vec![String::new()];
        for (at, part) in line.trim().split('\'').enumerate() {
            let quoted = at % 2 == 1;
            for (number, piece) in part.split(|character| character == ' ' && !quoted).enumerate() {
                if number > 0 {
                    words.push(String::new());
                }
                words.last_mut().expect("there is one").push_str(piece);
            }
        }
        words.retain(|word| !word.is_empty());
        words
    }

    /// Looks at a command and all those below it.
    fn visit(command: &clap::Command, path: &str, look: &mut dyn FnMut(&clap::Command, &str)) {
        look(command, path);
        for inner in command.get_subcommands().filter(|inner| !inner.is_hide_set() && inner.get_name() != "help") {
            visit(inner, &format!("{path} {}", inner.get_name()), look);
        }
    }

    #[test]
    fn every_command_has_examples_and_they_parse() {
        let mut seen = 0;
        visit(&Cli::command(), "fleetfoot", &mut |command, path| {
            if command.has_subcommands() && path != "fleetfoot" {
                return;
            }
            let help = command.get_after_help().unwrap_or_else(|| panic!("`{path}` has no examples")).to_string();
            for line in help.lines().filter(|line| line.starts_with("  fleetfoot ")) {
                // The overview explains each of its lines, behind some blanks.
                let line = line.trim().split("   ").next().unwrap_or_default();
                assert!(line.starts_with(path), "an example of `{path}` is of another command: {line}");
                let parsed = Cli::try_parse_from(words(line));
                assert!(parsed.is_ok(), "{line}\n{}", parsed.unwrap_err());
                seen += 1;
            }
        });
        assert!(seen > 30, "{seen} examples were seen");
    }

    #[test]
    fn help_states_every_default() {
        let mut silent = Vec::new();
        visit(&Cli::command(), "fleetfoot", &mut |command, path| {
            let options = command.get_arguments().filter(|argument| {
                argument.get_action().takes_values() && !argument.is_required_set() && !argument.is_positional()
            });
            for option in options.filter(|option| !option.is_hide_set() && option.get_default_values().is_empty()) {
                let help = option.get_help().map(ToString::to_string).unwrap_or_default();
                if !["default", "without it", "may be repeated"].iter().any(|word| help.contains(word)) {
                    silent.push(format!("{path} --{}", option.get_id()));
                }
            }
        });
        assert!(silent.is_empty(), "what holds without these options is not told: {silent:#?}");
    }
}
