//! Boards and glue of the meshband node.
#![no_std]
