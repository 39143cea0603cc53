// SPDX-License-Identifier: Apache-2.0
// The keeper handles what belongs to a machine, not to one end of a round trip. One process per machine,
// outside any network namespace, for a whole suite. It carries out a coordinator's orders (orders/orders.hpp)
// and restores what it changed, however it ends.
//
//   order                 answer
//   open   {transports}   opened {machine, notes, program, lacks}: its description, what was restored after
//                         earlier ontimes, the path of this program, why some transports were not found
//   join   {components, cable, wire}
//                         joined {hosts}: namespaces, of the controller and of each component by its name,
//                         {place, interface, address, port: of the controller's bridge, "" without a
//                         bridge}; cable: null, or the names of two interfaces that join the controller
//                         and its one component; wire: null, or {bits_per_s, vlan}
//   tune   {host, link, wishes}  tuned {note: of a setting without effect, for people, or ""}: all settings
//                         are applied to a host, until restore; or {error, refused: the setting that this
//                         machine cannot have}, and nothing is changed; without `refused` the error is not
//                         about a setting
//   look   {link, wishes} looked {interface: "" where it is not known, network_namespace, cannot: "NAME: why"
//                         this machine cannot have the setting, or "", without_effect: "NAME: why" it has
//                         none here, or "", is_root, cpu_latency: why it takes no such request, or ""};
//                         nothing is changed
//   isolate {host, link, wish}
//                         isolated {stay: what can still run on the reserved CPUs, for people, or ""},
//                         until restore, or another wish, before any tune; or {error}, and nothing is changed
//   keep   {pid}          kept {}, or {error}: that process has the reserved CPUs
//   restore {}            restored {notes}: what could not be restored
//   load   {host, load}   loaded {scaled}, or {error}: stress-ng for a host of that name, until unload;
//                         `scaled`: for people, "" as a rule
//   check  {faults}       checked {}, or {error, root_by}: the fault that this kernel lacks; `root_by`: only
//                         if root is missing: how this container gives it, or ""
//   link   {host, network_namespace, interface, faults, traffic_ports, by_ip}
//                         linked {}, or {error}: the end's interface has these faults, and is counted, until
//                         unload: what goes by other UDP ports than these, where messages go `by_ip`
//   cut    {host, after_ms, for_ms}   cutting {}, and when it is time: cut {host, at_ns}
//   traffic {host, way, stream}   flowing {}, or {error}: one end of one way of it, by iperf3, until
//                         unload
//   trace  {}             tracing {missing}: the kernel's events are kept for some seconds, until unload;
//                         what this kernel cannot trace, for people; or {error}
//   cut-out {spans [[message, from_ns, to_ns] …]}   window {window} for each of them, as soon as possible
//   unload {}             unloaded {notes}: what of the load could not be removed
//   begin  {}             begun {}: "during the run" is from here on
//   end    {links: {host: link}}
//                         ended {conditions, hosts {host: …}, traffic {host: {way: …}}, links {host: …},
//                         others, machine}: a record::Activity; for each host with them a record::Host's
//                         load, changed settings, reserved CPUs and, of `links`, all settings at this moment;
//                         record::Links; the commands of other ontimes that changed this machine at begin or
//                         end; and the machine as it was at begin, but its clock as it is now, with moved_ns:
//                         how far it was set since
//   close  {}             closed {notes}: what could not be restored
#pragma once

#include <span>

#include <nlohmann/json.hpp>

#include "background/background.hpp"
#include "conditions/conditions.hpp"

namespace ontime::background {
// Without `groups`: the keeper has its own.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Stream, place, serves, receives, address, interface, port, bits_per_s,
                                   datagram_bytes, priority)
}  // namespace ontime::background
namespace ontime::journal {
struct Kind;
}

namespace ontime::keeper {

nlohmann::json to_json(const conditions::Workers&);
conditions::Workers workers_of(const nlohmann::json&);
nlohmann::json to_json(const conditions::Isolation&);
conditions::Isolation wish_of(const nlohmann::json&);
nlohmann::json to_json(const conditions::Faults&);
conditions::Faults faults_of(const nlohmann::json&);

// The journal kinds of all modules: everything that ontime changes on a machine.
std::span<const journal::Kind> kinds();

// Carries out orders from standard input until its end. Returns the exit code.
int serve();

}  // namespace ontime::keeper
