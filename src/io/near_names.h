/* near_names.h - pictures whose names on disk have another ending or another case than a project says, as
 * after a conversion, or a copy through a file system that does not tell cases apart. */
#ifndef SF_IO_NEAR_NAMES_H
#define SF_IO_NEAR_NAMES_H

#include "dataset.h"

/* Takes the picture beside the entry's path whose name differs in ending and case alone, if there is exactly
 * one, and sets near_name. Else nothing changes. SF_ERR_MEMORY. */
sf_status sf_entry_take_near(sf_context *ctx, sf_entry *entry);

/* The same for all entries whose path is no file; logs how many have a near_name. */
sf_status sf_project_take_near(sf_project *project);

#endif
