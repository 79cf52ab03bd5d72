#!/bin/sh
# mpi.sh KIND VERSION - the page of the manual of splatfit-KIND, openmpi or mpich, on standard output.
set -eu

case $1 in
openmpi)
    option='\\-\\-hostfile' line='board1 slots=1'
    binding='Open MPI binds a rank to few processors; \\fBmpirun.openmpi \\-\\-bind\\-to none\\fR leaves it all of them.'
    ;;
mpich)
    option='\\-f' line='board1:1'
    binding='MPICH leaves a rank all of them.'
    ;;
*)
    echo "mpi.sh: $1: neither openmpi nor mpich" >&2
    exit 2
    ;;
esac
sed -e "s/@KIND_UPPER@/$(echo "$1" | tr '[:lower:]' '[:upper:]')/g" -e "s/@KIND@/$1/g" -e "s/@VERSION@/$2/g" \
    -e "s/@HOSTS_OPTION@/$option/g" -e "s/@HOSTS_LINE@/$line/g" -e "s/@BINDING@/$binding/g" "$(dirname "$0")/mpi.in"
