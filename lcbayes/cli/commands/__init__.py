"""The subcommands of `lcbayes`, one module each: `add_arguments(parser)` and `run(args) -> int`."""
