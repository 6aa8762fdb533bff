//! The AN386 image in QEMU: end to end, and under faults.

mod end_to_end;
mod fault_campaign_qemu;
mod fault_link_qemu;
mod qemu_runner;
mod virtual_node;
