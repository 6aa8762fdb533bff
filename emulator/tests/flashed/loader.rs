//! How the flashed loader and its image start from what other code leaves behind that jumps to it without a reset, as
//! the ROM loader does after `:leave`.

use super::compared::{Node, STARTED_S, configuration, machine, turns};
use super::image::image;
use meshband_emulator::unicorn::Register;

/// Vector table offset register of the core.
const VTOR: u32 = 0xe000_ed08;
/// Where the loader's own vectors are said to be: not the image's.
const FOREIGN_VECTORS: u32 = 0x2000_0000;

#[test]
fn fault_a_jump_into_the_image_without_a_reset_starts_a_node_whose_frames_are_right() {
    let Some(image) = image("loader") else { return };
    let mut node = Node::new(&image, &configuration());
    node.board.set_analogue(machine(25.0));
    // PLL as the clock, every device running, interrupts let in: more than a loader leaves.
    node.run_until(0.22);
    assert!(!node.blocks.is_empty(), "it samples");
    node.forget();
    let board = &mut node.board;
    while board.chip().nvic.depth() > 0 {
        let next = board.seconds() + 1e-6;
        board.run_until(next).expect("runs");
    }
    board.chip_mut().write(VTOR, 4, FOREIGN_VECTORS).expect("a register");
    let [stack, entry] = [0x0800_0000, 0x0800_0004].map(|at| board.chip_mut().peek(at).expect("in flash"));
    board.cpu().set_register(Register::SP, stack);
    board.cpu().set_program_counter(entry);
    let start_s = board.seconds();
    board.add_tach_edges(&turns(25.0, start_s + STARTED_S, start_s + 4.0));
    node.run_until(start_s + 4.0);
    assert_eq!(node.resets(), 0);
    assert!(node.blocks.len() > 100, "{} blocks", node.blocks.len());
    let statuses = node.messages().into_iter().filter(|m| matches!(m, meshband::message::Message::Status(_))).count();
    assert!(statuses > 2, "{statuses} statuses");
}
