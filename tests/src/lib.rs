//! Helpers shared by the tests: flash that fails, gear signals of known content, nodes in QEMU, the damage campaign,
//! the targets of fuzzing, the bill of materials.

#[cfg(unix)]
pub mod damage;
#[cfg(unix)]
pub mod fuzz;
pub mod gear_signal;
pub mod mock_flash;
pub mod plant;
pub mod qemu_node;
pub mod registers;
pub mod script;
pub mod supply;
