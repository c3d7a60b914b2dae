/* What the state machine of GMP needs of its platform, in the place of gmp_core.h. */

#include <stdint.h>

typedef int32_t fast_gt;
typedef uint32_t time_gt;
#define GMP_STATIC_INLINE static inline
