#!/usr/bin/env bash
# A Slurm cluster of one node on the loopback address, for a test:   slurm.sh start DIR   |   slurm.sh stop DIR
# Needs root and Debian's packages slurm-wlm and munge. Refuses where a Slurm configuration is already there.
set -euo pipefail
action=$1 dir=$2 conf=/etc/slurm/slurm.conf node=$(hostname -s)

configuration() {
  cat <<END
# one-node test cluster of $dir
ClusterName=local
SlurmctldHost=$node(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
CryptoType=crypto/munge
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
MpiDefault=none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MinJobAge=600
NodeName=$node NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=16000 State=UNKNOWN
PartitionName=debug Nodes=$node Default=YES MaxTime=INFINITE DefMemPerCPU=1000 State=UP
END
}

start() {
  mkdir -p "$dir/state" "$dir/spool" /etc/slurm /run/munge
  configuration > "$dir/slurm.conf"
  if [ -e $conf ] && [ "$(readlink $conf)" != "$dir/slurm.conf" ]; then
    echo "$conf is already there: this machine has a Slurm of its own" >&2
    exit 1
  fi
  ln -sfn "$dir/slurm.conf" $conf
  [ -e /etc/munge/munge.key ] || { dd if=/dev/urandom of=/etc/munge/munge.key bs=1 count=1024 2>/dev/null; }
  chown munge: /etc/munge/munge.key /run/munge
  chmod 400 /etc/munge/munge.key
  runuser -u munge -- munged --force --pid-file /run/munge/munged.pid
  slurmctld -f $conf
  slurmd -f $conf -N "$node"
  for _ in $(seq 40); do
    srun -n1 true 2>/dev/null && return
    sleep 0.5
  done
  echo "no answer from Slurm; see $dir/*.log" >&2
  exit 1
}

stop() {
  scancel --user="$(id -un)" 2>/dev/null || true
  for pid in "$dir/slurmd.pid" "$dir/slurmctld.pid" /run/munge/munged.pid; do
    [ -e "$pid" ] && kill "$(cat "$pid")" || true
  done
  [ "$(readlink $conf)" != "$dir/slurm.conf" ] || rm $conf
}

"$action"
