#!/bin/bash
# network.sh - times steps of a fit whose ranks have a network link of a given speed each, to check the model of src/cluster.
#
#     tests/bench/network.sh PROGRAM PROJECT MODEL.ply [ROUNDS]
#
# PROGRAM is splatfit-openmpi, MODEL.ply what is fitted without growth. Each rank is a host of its own: a network namespace with
# one link to a bridge, which the kernel's token buckets (tc tbf) hold to a rate in both directions, but for the first 128 KB
# after a pause. Needs root and iproute2. Prints a table: milliseconds a step, those beyond the same ranks on unlimited links, and
# bytes of the rank that sends most / rate. The hosts share this machine's processors: more ranks than those compute no faster.
set -euo pipefail

program=$(realpath "$1") project=$(realpath "$2") model=$(realpath "$3") rounds=${4:-3}
scratch=$(mktemp -d)
hub=splatfit-hub
steps=60
[ "$(id -u)" = 0 ] || {
    echo "network.sh: network namespaces need root" >&2
    exit 2
}

remove() {
    local i
    for i in 0 1 2 3; do ip netns delete splatfit-$i 2>/dev/null || true; done
    ip netns delete $hub 2>/dev/null || true
}
trap 'remove; rm -rf "$scratch"' EXIT
remove
ip netns add $hub
ip netns exec $hub ip link add bridge0 type bridge
ip netns exec $hub ip link set bridge0 up
for i in 0 1 2 3; do
    ip netns add splatfit-$i
    ip link add port$i netns $hub type veth peer name eth0 netns splatfit-$i
    ip netns exec $hub ip link set port$i master bridge0 up
    ip netns exec splatfit-$i ip addr add 10.77.0.$((i + 1))/24 dev eth0
    ip netns exec splatfit-$i ip link set eth0 up
    ip netns exec splatfit-$i ip link set lo up
done

limit() { # RATE or "none"
    local i
    for i in 0 1 2 3; do
        ip netns exec splatfit-$i tc qdisc delete dev eth0 root 2>/dev/null || true
        ip netns exec $hub tc qdisc delete dev port$i root 2>/dev/null || true
        [ "$1" != none ] || continue
        ip netns exec splatfit-$i tc qdisc add dev eth0 root tbf rate "$1" burst 128k latency 200ms
        ip netns exec $hub tc qdisc add dev port$i root tbf rate "$1" burst 128k latency 200ms
    done
}

# Open MPI takes processes of one host name to share memory, so each namespace has a name of its own. What mpirun calls to start
# its daemon on another host, in place of ssh: AGENT ADDRESS COMMAND...
cat >"$scratch/agent" <<'AGENT'
#!/bin/bash
i=$((${1##*.} - 1))
shift
exec nsenter --net=/run/netns/splatfit-$i unshare --uts sh -c "hostname board$i; exec sh -c \"\$0\"" "$*"
AGENT
chmod +x "$scratch/agent"

ranks() { # N
    local hosts
    hosts=$(seq -s, -f '10.77.0.%.0f' 1 "$1")
    ip netns exec splatfit-0 unshare --uts sh -c 'hostname board0; exec "$@"' - \
        mpirun.openmpi --allow-run-as-root --bind-to none --mca plm_rsh_agent "$scratch/agent" --mca btl tcp,self \
        --mca btl_tcp_if_include eth0 --mca oob_tcp_if_include eth0 -n "$1" --host "$hosts" \
        "$program" fit "$project" --from "$model" --freeze --steps $steps --threads 1 --hold-out 0 --cameras none \
        --progress none -o "$scratch/out.ply" >"$scratch/log" 2>&1 || {
        cat "$scratch/log" >&2
        exit 1
    }
}

for ((round = 0; round < rounds; round++)); do
    for n in 2 4; do
        for rate in none 10gbit 1gbit; do
            limit $rate
            ranks $n
            ms=$(sed -nE 's/.*\(([0-9.]+) ms a step.*/\1/p' "$scratch/log")
            kb=$(sed -nE 's/^rank .* ([0-9]+) kB a step.*/\1/p' "$scratch/log" | sort -n | tail -n 1)
            echo "$n $rate $ms $kb" >>"$scratch/runs"
        done
    done
done

echo "| ranks | link | ms a step | beyond unlimited links | bytes / rate |"
echo "| --- | --- | --- | --- | --- |"
sort -k1,2 -k3n "$scratch/runs" | awk '
    { key = $1 " " $2; count[key]++; ms[key, count[key]] = $3; kb[key] = $4 }
    END {
        split("none 10gbit 1gbit", rates); split("0 10 1", gbit)
        for (n = 2; n <= 4; n += 2) for (r = 1; r <= 3; r++) {
            key = n " " rates[r]; median = ms[key, int((count[key] + 1) / 2)]
            if (r == 1) free = median
            line = "| " n " | " (r == 1 ? "unlimited" : gbit[r] " Gbit/s") " | " median " | "
            print line (r == 1 ? " | |" : sprintf("%.1f | %.1f |", median - free, kb[key] / gbit[r] / 125))
        }
    }'
