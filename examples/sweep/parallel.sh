#!/bin/sh
# GNU parallel: as many shards at once as there are processors, here or on the hosts of --sshlogin.
#   examples/sweep/parallel.sh STUDY.toml DIR SHARDS
set -eu
study=$1 out=$2 shards=$3
seq "$shards" | parallel ${STRIDEMAP:-stridemap} sweep "$study" --shard "{}/$shards" --out "$out"
exec ${STRIDEMAP:-stridemap} sweep merge "$out"
