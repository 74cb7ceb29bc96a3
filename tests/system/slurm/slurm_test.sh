#!/bin/bash
# The job array on a real Slurm: controller, node and munge on this machine, in a folder of their own. slurm_test.sh BINDIR SOURCEDIR
# Exit status 77: skipped, with one line that says why.
set -euo pipefail
bin=$1 source=$2
skip() { echo "SKIPPED: $*"; exit 77; }
for tool in munged slurmctld slurmd sbatch squeue scontrol scancel sinfo; do
    command -v "$tool" >/dev/null || [ -x "/usr/sbin/$tool" ] || skip "$tool is not installed (apt-get install slurm-wlm munge)"
done
PATH=$PATH:/usr/sbin
[ "$(id -u)" -eq 0 ] || skip "Slurm's node runs jobs of others: only root can start it"

work=$(mktemp -d "${TMPDIR:-/tmp}/hord-slurm.XXXXXX")
chmod 755 "$work"
pids=()
clean_up() {
    local pid
    [ -z "${SLURM_CONF:-}" ] || timeout 20 scancel --user=root --state=RUNNING,PENDING >/dev/null 2>&1 || true
    for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
    for pid in "${pids[@]}"; do wait "$pid" 2>/dev/null || true; done
    rm -rf --one-file-system "$work"
}
trap clean_up EXIT
failed() {
    echo "FAILED: $*"
    tail -n 30 "$work"/*.log "$work"/out/*.out 2>/dev/null || true
    exit 1
}
wait_for() {  # wait_for WHAT COMMAND...: up to two minutes
    local what=$1 k
    shift
    for k in $(seq 600); do
        "$@" >/dev/null 2>&1 && return
        [ ${#pids[@]} -lt 3 ] || alive 2>/dev/null || break
        sleep 0.2
    done
    echo "no $what"
    return 1
}
free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }

# -- a cluster of one node -------------------------------------------------------------------------------------
host=$(hostname -s)
mkdir -p "$work"/{munge,state,spool,out}
chmod 755 "$work/munge"
head -c 1024 /dev/urandom >"$work/munge/key"
chmod 600 "$work/munge/key"
munged --foreground --force --socket="$work/munge/socket" --key-file="$work/munge/key" --pid-file="$work/munge/pid" --seed-file="$work/munge/seed" \
    --log-file="$work/munge.log" >"$work/munged.log" 2>&1 &
pids+=($!)
wait_for munged test -S "$work/munge/socket" || skip "munged cannot be started here: $(tail -n 1 "$work/munged.log")"

cat >"$work/slurm.conf" <<CONF
ClusterName=hord
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$work/slurm.conf
# Control groups are not used; these settings keep Slurm away from those of this machine.
printf 'CgroupPlugin=cgroup/v1\nCgroupAutomount=no\nCgroupMountpoint=%s\n' "$work/cgroup" >"$work/cgroup.conf"
slurmctld -D -f "$SLURM_CONF" >"$work/slurmctld.log" 2>&1 &
pids+=($!)
slurmd -D -f "$SLURM_CONF" -N "$host" >"$work/slurmd.log" 2>&1 &
pids+=($!)
alive() { kill -0 "${pids[1]}" && kill -0 "${pids[2]}"; }
idle() { [ "$(sinfo -h -o %t | head -n 1)" = idle ]; }
wait_for "idle node" idle || { tail -n 5 "$work"/slurm*.log; skip "Slurm cannot be started here: $(grep -h -i -E 'fatal|error' "$work"/slurm{d,ctld}.log | head -n 1)"; }

# -- an archive, and its result on one machine -----------------------------------------------------------------
"$bin/hord_test_archive" "$work/store" 30 || failed "no archive"
"$bin/hordctl" replay --store "$work/store" --out "$work/one.jsonl" || failed "the replay on one machine"

export HORD_STORE=$work/store HORD_OUT=$work/out HORD_SHARDS=3 HORDCTL=$bin/hordctl
submit() { sbatch --parsable --mem=0 --output="$work/out/%a.out" "$@" "$source/deploy/slurm/hord-replay.sbatch"; }
ended() { [ -z "$(squeue -h -j "$1" 2>/dev/null)" ]; }
state_of() { scontrol show job "$1" 2>/dev/null | grep -o 'JobState=[A-Z_]*' | sort -u | tr '\n' ' '; }

# The second task fails at its start: its program kills itself, as on a node failure.
printf '#!/bin/bash\nkill -KILL $$\n' >"$work/dies"
chmod 755 "$work/dies"
first=$(submit --array=1,3)
HORDCTL=$work/dies
killed=$(submit --array=2)
HORDCTL=$bin/hordctl
wait_for "end of the array" ended "$first" || failed "the array did not end: $(state_of "$first")"
wait_for "end of the killed task" ended "$killed" || failed "the killed task did not end"
[ "$(ls "$work"/out/*.jsonl | wc -l)" -eq 2 ] || failed "not the two shards of the tasks that ran: $(ls "$work/out")"
if "$bin/hordctl" merge "$work"/out/*.jsonl --out "$work/merged.jsonl" 2>"$work/refusal"; then failed "merged without shard 2"; fi
grep -q 'shards are missing: 2/3' "$work/refusal" || failed "the missing shard is not named: $(cat "$work/refusal")"

again=$(submit --array=2)
wait_for "end of the task that was run again" ended "$again" || failed "it did not end: $(state_of "$again")"
"$bin/hordctl" merge "$work"/out/*.jsonl --out "$work/merged.jsonl" || failed "merge"
cmp "$work/one.jsonl" "$work/merged.jsonl" || failed "the cluster's bytes are not those of one machine"
case "$(state_of "$first$again")" in *FAILED*) failed "a task failed" ;; esac
echo "3 tasks of a job array, one killed and run again: the same bytes as one machine"
