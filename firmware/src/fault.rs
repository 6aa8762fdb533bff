//! Entry of the hard fault, in front of what a board does about it.
//!
//! A stack that has outgrown its memory leaves the stack pointer where nothing is mapped: the first push of any handler
//! would fault again and lock the core up. So this entry touches no stack; where less is left than a handler needs it
//! starts the stack afresh, for nothing returns from here.
//!
//! Each image defines `on_fault(program_counter, stack_overflow)`; the program counter is zero after an overflow.

use core::arch::global_asm;

global_asm!(
    ".section .HardFault.meshband, \"ax\", %progbits",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "    mrs r2, msp",
    // 512 bytes: what recording a crash takes.
    "    ldr r3, =_stack_end + 512",
    "    movs r1, #0",
    "    cmp r2, r3",
    "    blo 1f",
    // Behind r0 to r3, r12 and lr in the frame the core pushed.
    "    ldr r0, [r2, #24]",
    "    b 2f",
    "1:  movs r0, #0",
    "    movs r1, #1",
    "    ldr r3, =_stack_start",
    "    msr msp, r3",
    "2:  bl on_fault",
    "    udf #0",
    ".size HardFault, . - HardFault",
);
