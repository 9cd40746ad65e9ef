//! Networks as ONNX files, none of their bytes to be trusted.
//!
//! The first two bytes of an input are the numbers of inputs and outputs, the rest is the file. A network that is read has a map for every output, which
//! fits its inputs. Errors are fine; panics, hangs and memory beyond measure are not.

use fleetfoot_codegen::OnnxNetwork;

/// Reads one input; whether it was accepted. Panics where a promise is broken.
pub(crate) fn run(data: &[u8]) -> bool {
    let [inputs, outputs, file @ ..] = data else { return false };
    let names = |count: u8| (0..count).map(|at| format!("c{at}")).collect::<Vec<String>>();
    let (inputs, outputs) = (names(*inputs), names(*outputs));
    let Ok(network) = OnnxNetwork::read(file, &inputs, &outputs) else { return false };
    let maps = network.maps();
    assert_eq!(maps.len(), outputs.len(), "a map an output");
    for map in maps {
        map.check(inputs.len(), 1).expect("a map that fits its inputs");
        let _ = map.value(0, &vec![0.0; inputs.len()]);
    }
    true
}
