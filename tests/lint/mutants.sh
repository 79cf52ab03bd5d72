#!/bin/sh
# mutants.sh - the texts that tests/mutants edits are there, each once.
exec tests/mutants/run.sh --look
