// SPDX-License-Identifier: Apache-2.0
#include "security/security.hpp"

#include <array>

#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

namespace ontime::security {
namespace {

constexpr std::array protections{"NONE", "NONE", "SIGN", "ENCRYPT"};  // DDS Security's, of each level

// As long as any clock of a robot may say that it is, also one that was never set: the keys are gone with the
// run.
constexpr const char *begin = "19700101000000Z", *end = "20491231235959Z";
constexpr const char *begin_of_permissions = "1970-01-01T00:00:00",
                     *end_of_permissions = "2037-12-31T23:59:59";

template <auto free>
struct Deleter {
  template <typename Thing>
  void operator()(Thing* thing) const {
    free(thing);
  }
};
using Key = std::unique_ptr<EVP_PKEY, Deleter<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Deleter<X509_free>>;
using Bytes = std::unique_ptr<BIO, Deleter<BIO_free_all>>;
using Signed = std::unique_ptr<PKCS7, Deleter<PKCS7_free>>;

void must(bool done, const char* what) {
  if (done) return;
  std::array<char, 256> why{};
  ERR_error_string_n(ERR_get_error(), why.data(), why.size());
  throw transport::Error(fmt::format("DDS Security: OpenSSL failed ({}): {}", what, why.data()));
}

std::string text_of(const Bytes& bytes) {
  char* data = nullptr;
  const auto length = BIO_get_mem_data(bytes.get(), &data);
  return {data, static_cast<std::size_t>(length)};
}

Key new_key() {
  Key key(EVP_EC_gen("P-256"));
  must(key != nullptr, "key");
  return key;
}

std::string pem_of(const Key& key) {
  const Bytes bytes(BIO_new(BIO_s_mem()));
  must(PEM_write_bio_PrivateKey(bytes.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) == 1,
       "text of a key");
  return text_of(bytes);
}
std::string pem_of(const Certificate& certificate) {
  const Bytes bytes(BIO_new(BIO_s_mem()));
  must(PEM_write_bio_X509(bytes.get(), certificate.get()) == 1, "text of a certificate");
  return text_of(bytes);
}

void extend(X509* certificate, int what, const char* value) {
  X509_EXTENSION* const extension = X509V3_EXT_nconf_nid(nullptr, nullptr, what, value);
  must(extension != nullptr && X509_add_ext(certificate, extension, -1) == 1, "extension of a certificate");
  X509_EXTENSION_free(extension);
}

// Signed by the issuer, or by itself.
Certificate certificate_of(const std::string& name, const Key& key, const X509* issuer, const Key& by) {
  Certificate made(X509_new());
  must(made != nullptr && X509_set_version(made.get(), 2) == 1, "certificate");
  std::array<unsigned char, 8> random{};
  must(RAND_bytes(random.data(), random.size()) == 1, "random number");
  std::uint64_t number = 1;
  for (const auto byte : random) number = number << 7U | (byte & 0x7fU);
  must(ASN1_INTEGER_set_uint64(X509_get_serialNumber(made.get()), number) == 1, "serial number");
  X509_NAME* const subject = X509_get_subject_name(made.get());
  must(X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8,
                                  reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1, 0) == 1,
       "name");
  must(X509_set_issuer_name(made.get(), issuer == nullptr ? subject : X509_get_subject_name(issuer)) == 1,
       "issuer");
  must(ASN1_TIME_set_string(X509_getm_notBefore(made.get()), begin) == 1 &&
           ASN1_TIME_set_string(X509_getm_notAfter(made.get()), end) == 1,
       "time of validity");
  must(X509_set_pubkey(made.get(), key.get()) == 1, "public key");
  if (issuer == nullptr) extend(made.get(), NID_basic_constraints, "critical,CA:TRUE");
  must(X509_sign(made.get(), by.get(), EVP_sha256()) > 0, "signature");
  return made;
}

constexpr const char* head =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
    "xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd\">\n";

// The payload is protected as the level says, and nothing else is: so what a level costs is that alone.
std::string governance_of(Level level, int domain) {
  const auto* const protection = protections.at(static_cast<std::size_t>(level));
  return fmt::format(fmt::runtime(head), "governance") +
         fmt::format(
             "<domain_access_rules><domain_rule>\n"
             "<domains><id>{}</id></domains>\n"
             "<allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
             "<enable_join_access_control>true</enable_join_access_control>\n"
             "<discovery_protection_kind>NONE</discovery_protection_kind>\n"
             "<liveliness_protection_kind>NONE</liveliness_protection_kind>\n"
             "<rtps_protection_kind>NONE</rtps_protection_kind>\n"
             "<topic_access_rules><topic_rule>\n"
             "<topic_expression>*</topic_expression>\n"
             "<enable_discovery_protection>false</enable_discovery_protection>\n"
             "<enable_liveliness_protection>false</enable_liveliness_protection>\n"
             "<enable_read_access_control>true</enable_read_access_control>\n"
             "<enable_write_access_control>true</enable_write_access_control>\n"
             "<metadata_protection_kind>NONE</metadata_protection_kind>\n"
             "<data_protection_kind>{}</data_protection_kind>\n"
             "</topic_rule></topic_access_rules>\n"
             "</domain_rule></domain_access_rules>\n"
             "</dds>\n",
             domain, protection);
}

std::string permissions_of(const std::string& name, int domain) {
  return fmt::format(fmt::runtime(head), "permissions") +
         fmt::format(
             "<permissions><grant name=\"{0}\">\n"
             "<subject_name>CN={0}</subject_name>\n"
             "<validity><not_before>{2}</not_before><not_after>{3}</not_after></validity>\n"
             "<allow_rule>\n"
             "<domains><id>{1}</id></domains>\n"
             "<publish><topics><topic>*</topic></topics></publish>\n"
             "<subscribe><topics><topic>*</topic></topics></subscribe>\n"
             "</allow_rule>\n"
             "<default>DENY</default>\n"
             "</grant></permissions>\n"
             "</dds>\n",
             name, domain, begin_of_permissions, end_of_permissions);
}

}  // namespace

struct Authority::Signer {
  Key key = new_key();
  Certificate certificate = certificate_of("ontime", key, nullptr, key);

  // As S/MIME with its text, which both vendors read.
  std::string sign(const std::string& text) const {
    constexpr int how = PKCS7_TEXT | PKCS7_DETACHED;
    const Bytes in(BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))), out(BIO_new(BIO_s_mem()));
    const Signed made(PKCS7_sign(certificate.get(), key.get(), nullptr, in.get(), how | PKCS7_STREAM));
    must(made != nullptr && SMIME_write_PKCS7(out.get(), made.get(), in.get(), how | PKCS7_STREAM) == 1,
         "signed document");
    return text_of(out);
  }
};

Authority::Authority() : signer_(std::make_unique<Signer>()) {}
Authority::~Authority() = default;

transport::Security Authority::identity(const std::string& name, Level level, int domain) const {
  const auto key = new_key();
  const auto certificate = certificate_of(name, key, signer_->certificate.get(), signer_->key);
  const auto authority = pem_of(signer_->certificate);
  return {.level = word_of(level),
          .identity_ca = authority,
          .identity_certificate = pem_of(certificate),
          .private_key = pem_of(key),
          .permissions_ca = authority,
          .governance = signer_->sign(governance_of(level, domain)),
          .permissions = signer_->sign(permissions_of(name, domain))};
}

}  // namespace ontime::security
