# SPDX-License-Identifier: Apache-2.0
# For a shell of `ontime lab`: runs with each queueing discipline over a wire of a rate and a VLAN, to their end, and one all
# of whose processes are killed; what tc, ip and a rule of nftables' that counts tagged frames then see. See test_lab.py.
classes="num_tc 2 map 1 1 1 1 1 1 0 1 1 1 1 1 1 1 1 1 queues 1@0 1@1"
{
  echo "hosts: namespaces"
  echo "wire: {rate: 10 Mbit/s, vlan: 5}"
  echo "defaults: {transport: udp, duration: 2 s, realtime: on, link: {message-priority: 6}}"
  echo "runs:"
  while read -r kind words; do echo "  - {id: $kind, link: {qdisc: $kind $words}}"; done <<DISCIPLINES
taprio $classes base-time 0 sched-entry S 01 1000000 sched-entry S 02 3000000 clockid CLOCK_TAI
mqprio $classes hw 0
cbs idleslope 5000 sendslope -5000 hicredit 300 locredit -300
DISCIPLINES
} >/tmp/wire.yaml
inside() { ip netns exec ontime-controller "$@"; }
see() {
  echo "$1 wire=$(inside tc qdisc show dev eth0 2>/dev/null | grep -o 'netem.*rate [^ ]*' | sed 's/netem.* //')"
  echo "$1 vlan=$(inside tc qdisc show dev vlan5 2>/dev/null | grep root | cut -d ' ' -f 2)"
  echo "$1 sent=$(inside tc -s qdisc show dev vlan5 2>/dev/null | grep -c 'Sent [1-9]')"
  echo "$1 tagged=$(ip netns exec ontime-component nft list table netdev seen 2>/dev/null | grep -c 'pcp 6 counter packets [1-9]')"
  echo "$1 left=$(ip -oneline link show | grep -c vlan5) $(tc qdisc show | grep -c 'netem\|taprio\|mqprio\|cbs')"
}
measure() { TERM=dumb ontime run --only-measure --cable eth0,eth1 --only "$1" --results "/tmp/$1.$2" /tmp/wire.yaml 2>&1; echo "$1 $2 ended $?"; }
measures() {
  until ps -eo args | grep -q '[o]ntime agent'; do sleep 0.1; done
  ip netns exec ontime-component nft 'table netdev seen { chain coming { type filter hook ingress device "eth1" priority -600; vlan pcp 6 counter; }; }'
  sleep 1
}

see before
for kind in taprio mqprio cbs; do
  measure $kind whole &
  measures
  see "$kind"
  wait
done
see after
measure taprio cut &
measures
kill -9 $(ps -C ontime -o pid=)
wait
see killed
ontime tune revert
echo "revert ended $?"
for nic in eth0 eth1; do until [ -e "/sys/class/net/$nic" ]; do sleep 0.1; done; done
see reverted
