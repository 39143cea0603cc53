# SPDX-License-Identifier: Apache-2.0
# For a shell of `ontime lab --live`, whose control groups are of version 2: a run that keeps CPU 1 to its end, one all
# of whose processes are killed, one beside which another process comes to use the controller, and what is refused; what /proc and
# taskset then see. See test_lab.py.
cat >/tmp/isolated.yaml <<'YAML'
hosts: namespaces
defaults: {transport: udp, duration: 20 s, realtime: {policy: fifo, cpus: 1}, load: {controller: {cpu: 1}}}
runs:
  - id: isolated
    isolation: {cpus: 1, interrupts: on, load-quota: 30 %, load-weight: 10}
YAML
groups=/sys/fs/cgroup
sleep 1000 &
bystander=$!
agents() { ps -eo pid=,args= | grep '[o]ntime agent' | sed 's/^ *//; s/ .*//'; }
cpus() { taskset -cp "$1" | sed 's/.*: //'; }
see() {
  echo "$1 others=$(cpus $bystander)"
  echo "$1 work=$(cat /sys/devices/virtual/workqueue/cpumask)"
  echo "$1 interrupts=$(for irq in $(grep -E 'eth[01]' /proc/interrupts | cut -d: -f1); do cat "/proc/irq/$irq/smp_affinity_list"; done | sort -u)"
  # The console's, whose interrupt comes all the time; another's takes its CPUs again when it next comes.
  echo "$1 thread=$(ps -eo pid=,comm= | grep 'irq/.*ttyS0' | while read -r pid name; do cpus "$pid"; done)"
  echo "$1 groups=$(cd $groups && echo ontime-*)"
  echo "$1 controllers=$(cat $groups/cgroup.subtree_control)"
  echo "$1 partition=$(cat $groups/ontime-robot/cpuset.cpus.partition 2>&1 | sed 's/.*: //')"
  echo "$1 agents=$(for pid in $(agents); do cpus "$pid"; done | sort -u)"
  echo "$1 limit=$(echo $(cat $groups/ontime-load/cpu.max $groups/ontime-load/cpu.weight 2>/dev/null))"
  echo "$1 load=$(grep -h ontime-load /proc/$(ps -C stress-ng -o pid= | head -n 1 | sed 's/ //g')/cgroup 2>/dev/null)"
}
measure() {
  name=$1
  shift
  TERM=dumb ontime run --only-measure --cable eth0,eth1 --results "/tmp/$name" "$@" /tmp/isolated.yaml 2>&1
  echo "$name ended $?"
}
measures() {
  until [ -n "$(agents)" ] && [ -n "$(ps -C stress-ng -o pid=)" ]; do sleep 0.1; done
  sleep 1.5
}

see before
measure whole &
measures
see during
wait %2
see after
measure cut &
measures
kill -9 $(ps -C ontime -o pid=)
sleep 1
see killed
ontime tune revert
echo "revert ended $?"
see reverted

measure used --duration '5 s' &
measures
mkdir $groups/other
echo 0 >$groups/other/cpuset.cpus
wait $!
see used
echo 1 >$groups/other/cpuset.cpus
measure taken
see taken
busybox rmdir $groups/other
echo -cpuset >$groups/cgroup.subtree_control
taskset -c 0 sleep 1000 &
pinned=$!
measure pinned
echo "pinned thread=$(cpus $pinned)"
kill $pinned
see refused
kill $bystander
